// Implements the verbs for live sessions.
#include "cli/SessionCommands.h"

#include <algorithm>
#include <array>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "cli/Json.h"
#include "cli/Reach.h"
#include "cli/Replay.h"
#include "cli/Text.h"
#include "lines/SessionMerge.h"
#include "transport/LiveSessions.h"

namespace usdlive::cli {

namespace {

using client::SessionConflict;
using client::SessionMerged;
using client::Take;

Json sessionJson(const client::ListedLiveSession& one, const client::ServerAddress& server) {
    return {{"name", one.name},         {"url", client::liveSessionAddress(server, one.name).url()},
            {"creator", one.creator},   {"time", one.timeMs},
            {"revision", one.revision}, {"ended", one.isEnded},
            {"merged", one.merged},     {"error", one.error},
            {"users", one.users}};
}

std::string sessionText(const client::ListedLiveSession& one, const client::ServerAddress& server) {
    std::string text = one.name + "  from " + inRevision(one.revision);
    if (!one.creator.empty()) text += " by " + one.creator;
    if (one.merged > 0) text += ", merged in " + inRevision(one.merged);
    if (!one.error.empty()) return text + ", cannot be opened: " + one.error;
    if (one.isEnded) return text + ", ended";
    for (const std::string& user : one.users)
        text += (&user == &one.users.front() ? ", in it: " : ", ") + user;
    return text + "  " + client::liveSessionAddress(server, one.name).url();
}

Result<void> listSessions(const SessionOptions& options) {
    const auto& server = options.target.server;
    const auto all = client::listLiveSessions(server, client::kSessionRequestTime);
    if (!all) return tl::unexpected(all.error());
    Json json = Json::array();
    for (const auto& one : *all)
        if (options.json)
            json.push_back(sessionJson(one, server));
        else
            std::cout << withoutControls(sessionText(one, server)) << "\n";
    if (options.json) std::cout << line(json);
    if (!options.json && all->empty())
        std::cout << "the project has no live sessions; usdlive session create NAME makes one\n";
    return {};
}

/// Returns the revision from which a session is to be created; 0: the newest.
Result<Revision> fromRevision(const SessionOptions& options) {
    if (options.from.empty()) return Revision(0);
    Common main = options;
    main.target.server = client::mainLineAddress(options.target.server);
    const auto link = reach(main);
    if (!link) return tl::unexpected(link.error());
    return revisionAt(**link, options.from);
}

Result<void> changeSession(const SessionOptions& options) {
    const auto user = userOf(options);
    if (!user) return tl::unexpected(user.error());
    const auto& server = options.target.server;
    const auto from = fromRevision(options);
    if (!from) return tl::unexpected(from.error());
    const auto done = client::changeLiveSession(server, options.name, options.verb, *user,
                                                client::kSessionRequestTime, *from);
    if (!done) return tl::unexpected(done.error());
    if (options.json)
        std::cout << line(sessionJson(*done, server));
    else if (options.verb == "delete")
        std::cout << "deleted " << done->name << "\n";
    else
        std::cout << withoutControls(sessionText(*done, server)) << "\n";
    return {};
}

// ---- merging

std::string shown(const std::optional<FieldValue>& value) {
    return value ? describe(*value) : std::string("nothing");
}

std::string by(const UserName& user) { return user.value.empty() ? "" : " (" + user.value + ")"; }

std::string conflictText(const SessionConflict& one) {
    const std::string where = one.layer.value + "  " + one.path;
    switch (one.what) {
        case SessionConflict::What::Value:
            return where + "  " + one.field + "  was " + shown(one.before) + ", main " +
                   shown(one.main) + by(one.mainUser) + ", session " + shown(one.session) +
                   by(one.sessionUser);
        case SessionConflict::What::Deleted:
            return where + (one.isDeletedInSession
                                ? "  main changed it" + by(one.mainUser) + ", session deleted it" +
                                      by(one.sessionUser)
                                : "  main deleted it" + by(one.mainUser) + ", session changed it" +
                                      by(one.sessionUser));
        case SessionConflict::What::Moved:
            return where + "  main" + by(one.mainUser) + " and session" + by(one.sessionUser) +
                   " renamed or moved it";
        case SessionConflict::What::Refused:
            return where + "  " + one.reason;
    }
    return where;
}

const char* nameOf(Take take) {
    constexpr std::array kNames{"undecided", "main", "session"};
    return kNames[std::size_t(take)];
}

Json conflictJson(const SessionConflict& one, BlobSource& blobs) {
    const auto value = [&](const std::optional<FieldValue>& held) {
        return held ? toJson(*held, blobs) : Json();
    };
    constexpr std::array kWhat{"value", "deleted", "moved", "refused"};
    return {{"what", kWhat[std::size_t(one.what)]},
            {"layer", one.layer.value},
            {"path", one.path},
            {"field", one.field},
            {"reason", one.reason},
            {"before", value(one.before)},
            {"main", value(one.main)},
            {"session", value(one.session)},
            {"mainUser", one.mainUser.value},
            {"sessionUser", one.sessionUser.value},
            {"take", nameOf(one.take)}};
}

Take decided(const SessionOptions& options, const SessionConflict& conflict) {
    const auto names = [&](const std::vector<std::string>& paths) {
        return std::ranges::any_of(paths, [&](const std::string& path) {
            return specpath::hasPrefix(conflict.path, path);
        });
    };
    if (names(options.mainPaths)) return Take::Main;
    if (names(options.sessionPaths)) return Take::Session;
    return options.take;
}

void printJson(const SessionMerged& merged, const SessionOptions& options, BlobSource& blobs) {
    Commit edits;
    edits.edits = merged.edits;
    Json json{{options.verb == "update" ? "updated" : "merged", merged.edits.size()},
              {"dryRun", options.dryRun},
              {"dropped", merged.dropped}};
    if (merged.revision > 0) json["revision"] = merged.revision;
    json["edits"] = toJson(edits, {}, blobs)["edits"];
    json["created"] = Json::array();
    for (const LayerId& layer : merged.created) json["created"].push_back(layer.value);
    json["conflicts"] = Json::array();
    for (const SessionConflict& one : merged.conflicts)
        json["conflicts"].push_back(conflictJson(one, blobs));
    std::cout << line(json);
}

void printMerged(const SessionMerged& merged, const SessionOptions& options) {
    const std::string name = withoutControls(options.name);
    const std::string done = options.verb == "update" ? "updated" : "merged";
    std::set<LayerId> layers;
    for (const Edit& edit : merged.edits) layers.insert(edit.layer);
    std::string names;
    for (const LayerId& layer : layers) names += (names.empty() ? "" : ", ") + layer.value;
    for (const SessionConflict& one : merged.conflicts)
        std::cout << nameOf(one.take) << "  " << conflictText(one) << "\n";
    if (merged.dropped > 0)
        std::cout << counted(merged.dropped, "edit") << " of specs that are not in the "
                  << (options.verb == "update" ? "session" : "main line")
                  << ": they are left out, too\n";
    if (merged.edits.empty())
        std::cout << name << " has nothing to be " << done << "\n";
    else if (merged.revision == 0)
        std::cout << "would be " << done << ": " << counted(merged.edits.size(), "edit") << " of "
                  << names << "\n";
    else
        std::cout << done << " " << name << (options.verb == "update" ? " in " : " into ") << names
                  << ": " << counted(merged.edits.size(), "edit") << ", "
                  << inRevision(merged.revision) << "\n";
    if (!options.dryRun) return;
    for (const LayerId& layer : merged.created)
        std::cout << "    " << layer.value << "  is created\n";
    for (const Edit& edit : merged.edits)
        std::cout << "    " << edit.layer.value << "  " << describe(edit) << "\n";
}

/// Merges a session into the main line, or the main line into a session.
Result<void> mergeSession(const SessionOptions& options) {
    const auto user = userOf(options);
    if (!user) return tl::unexpected(user.error());
    using Target = client::SessionMerge::Target;
    const Target target = options.verb == "update" ? Target::Session : Target::Main;
    const auto decide = [&](const SessionConflict& one) { return decided(options, one); };
    client::SessionMerge merging({options.target.server,
                                  options.name,
                                  *user,
                                  target,
                                  {options.dryRun, options.keep, decide}});
    const auto merged = merging.run();
    if (!merged) return tl::unexpected(merged.error());
    if (options.json)
        printJson(*merged, options, merging.blobs());
    else
        printMerged(*merged, options);
    if (options.dryRun) return {};
    if (merged->undecided > 0)
        return tl::unexpected(client::undecidedConflicts(
            merged->undecided,
            "Say --take main or --take session for all, --main PATH or --session PATH for some"));
    return options.keep || target == Target::Session ? Result<void>() : merging.end();
}

}  // namespace

Result<void> liveSession(const SessionOptions& options) {
    if (options.verb == "list") return listSessions(options);
    if (options.verb == "merge" || options.verb == "update") return mergeSession(options);
    return changeSession(options);
}

}  // namespace usdlive::cli
