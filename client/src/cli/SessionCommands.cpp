// Implements the verbs for live sessions.
#include "cli/SessionCommands.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "cli/Authoring.h"
#include "cli/Json.h"
#include "cli/Reach.h"
#include "cli/Replay.h"
#include "cli/Text.h"
#include "transport/LiveSessions.h"

namespace usdlive::cli {

namespace {

using client::MergeConflict;
using client::Side;

constexpr std::chrono::milliseconds kSessionTimeout{15'000};
constexpr double kConnectMs = 10'000;
constexpr Revision kCommitsPerPage = 1'000;

Json toJson(const client::ListedLiveSession& one, const client::ServerAddress& server) {
    return {{"name", one.name},         {"url", client::liveSessionAddress(server, one.name).url()},
            {"creator", one.creator},   {"time", one.timeMs},
            {"revision", one.revision}, {"ended", one.isEnded},
            {"merged", one.merged},     {"error", one.error}};
}

std::string sessionText(const client::ListedLiveSession& one, const client::ServerAddress& server) {
    std::string text = one.name + "  from " + inRevision(one.revision);
    if (!one.creator.empty()) text += " by " + one.creator;
    if (one.merged > 0) text += ", merged in " + inRevision(one.merged);
    if (!one.error.empty()) return text + ", cannot be opened: " + one.error;
    return text +
           (one.isEnded ? ", ended" : "  " + client::liveSessionAddress(server, one.name).url());
}

Result<void> listSessions(const SessionOptions& options) {
    const auto& server = options.target.server;
    const auto all = client::listLiveSessions(server, kSessionTimeout);
    if (!all) return tl::unexpected(all.error());
    Json json = Json::array();
    for (const auto& one : *all)
        if (options.json)
            json.push_back(toJson(one, server));
        else
            std::cout << withoutControls(sessionText(one, server)) << "\n";
    if (options.json) std::cout << line(json);
    if (!options.json && all->empty())
        std::cout << "the project has no live sessions; usdlive session create NAME makes one\n";
    return {};
}

Result<void> changeSession(const SessionOptions& options) {
    const auto user = userOf(options);
    if (!user) return tl::unexpected(user.error());
    const auto& server = options.target.server;
    const auto done =
        client::changeLiveSession(server, options.name, options.verb, *user, kSessionTimeout);
    if (!done) return tl::unexpected(done.error());
    if (options.json)
        std::cout << line(toJson(*done, server));
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

std::string conflictText(const MergeConflict& one) {
    const std::string where = one.layer.value + "  " + one.path;
    switch (one.what) {
        case MergeConflict::What::Value:
            return where + "  " + one.field + "  was " + shown(one.before) + ", main " +
                   shown(one.into) + by(one.intoUser) + ", session " + shown(one.from) +
                   by(one.fromUser);
        case MergeConflict::What::Deleted:
            return where + (one.isDeletedFrom ? "  main changed it" + by(one.intoUser) +
                                                    ", session deleted it" + by(one.fromUser)
                                              : "  main deleted it" + by(one.intoUser) +
                                                    ", session changed it" + by(one.fromUser));
        case MergeConflict::What::Moved:
            return where + "  main" + by(one.intoUser) + " and session" + by(one.fromUser) +
                   " renamed or moved it";
        case MergeConflict::What::Refused:
            return where + "  " + one.reason;
    }
    return where;
}

const char* nameOf(Side side) {
    return side == Side::From ? "session" : side == Side::Into ? "main" : "undecided";
}

Json toJson(const MergeConflict& one, Side side, Link& link) {
    const auto value = [&](const std::optional<FieldValue>& held) {
        return held ? toJson(*held, link) : Json();
    };
    constexpr std::array kWhat{"value", "deleted", "moved", "refused"};
    return {{"what", kWhat[std::size_t(one.what)]},
            {"layer", one.layer.value},
            {"path", one.path},
            {"field", one.field},
            {"reason", one.reason},
            {"before", value(one.before)},
            {"main", value(one.into)},
            {"session", value(one.from)},
            {"mainUser", one.intoUser.value},
            {"sessionUser", one.fromUser.value},
            {"take", nameOf(side)}};
}

Side decided(const SessionOptions& options, const MergeConflict& conflict) {
    const auto names = [&](const std::vector<std::string>& paths) {
        return std::ranges::any_of(paths, [&](const std::string& path) {
            return specpath::hasPrefix(conflict.path, path);
        });
    };
    if (names(options.mainPaths)) return Side::Into;
    if (names(options.sessionPaths)) return Side::From;
    return options.take;
}

/// The two lines of a merge, each over a connection of its own.
class Merging {
public:
    explicit Merging(const SessionOptions& options) : options_(options) {}

    Result<void> run() {
        return findSession()
            .and_then([&] { return connect(); })
            .and_then([&] { return readSession(); })
            .and_then([&] { return joinMain(); })
            .and_then([&] { return mergeNewest(); })
            .and_then([&] { return finish(); });
    }

private:
    Result<void> findSession() {
        const auto all = client::listLiveSessions(options_.target.server, kSessionTimeout);
        if (!all) return tl::unexpected(all.error());
        const auto found = std::ranges::find(*all, options_.name, &client::ListedLiveSession::name);
        if (found == all->end())
            return fail(ErrorCode::InvalidArgument, "the project has no live session " +
                                                        options_.name +
                                                        "; usdlive session list lists them");
        if (found->isEnded)
            return fail(ErrorCode::InvalidArgument,
                        "the live session " + options_.name + " was ended" +
                            (found->merged > 0 ? " and merged in " + inRevision(found->merged)
                                               : std::string()) +
                            "; usdlive session restore opens it again");
        session_ = *found;
        return {};
    }

    Result<void> connect() {
        const auto user = userOf(options_);
        if (!user) return tl::unexpected(user.error());
        user_ = *user;
        const auto& server = options_.target.server;
        auto main = Link::connect(client::mainLineAddress(server), *user, kConnectMs);
        if (!main) return tl::unexpected(main.error());
        auto from =
            Link::connect(client::liveSessionAddress(server, options_.name), *user, kConnectMs);
        if (!from) return tl::unexpected(from.error());
        into_ = std::move(*main);
        from_ = std::move(*from);
        into_->lend(*from_);
        return {};
    }

    /// Calls `use` with the commits of a line after the revision at which the lines parted.
    template <class Use>
    static Result<void> eachCommit(Link& link, Revision after, Revision to, Use use) {
        for (Revision from = after + 1; from <= to; from += kCommitsPerPage) {
            const auto commits = link.readLog(from, std::min(to, from + kCommitsPerPage - 1));
            if (!commits) return tl::unexpected(commits.error());
            for (const Commit& commit : *commits)
                if (auto used = use(commit); !used) return used;
        }
        return {};
    }

    Result<void> readSession() {
        std::vector<Commit> commits;
        std::set<LayerId> layers;
        read_ = from_->welcome().revision;
        auto read =
            eachCommit(*from_, session_.revision, read_, [&](const Commit& commit) -> Result<void> {
                for (const Edit& edit : commit.edits) layers.insert(edit.layer);
                commits.push_back(commit);
                return {};
            });
        if (!read) return read;
        LayerDocs common;
        for (const LayerId& layer : layers) {
            auto content = from_->readLayer(layer, std::max<Revision>(session_.revision, 1));
            if (!content) return tl::unexpected(content.error());
            common.emplace(layer, std::move(content->doc));
        }
        merge_.emplace(std::move(common), session_.revision);
        for (const Commit& commit : commits)
            if (auto added = merge_->addFrom(commit); !added) return added;
        return {};
    }

    /// Joins the layers that the session has changed. Creates those that it has created.
    Result<void> joinMain() {
        std::set<LayerId> layers;
        for (const LayerId& layer : merge_->changed()) {
            if (!hasLayer(*into_, layer)) {
                created_.insert(layer);
                if (options_.dryRun) continue;
                if (const auto created = into_->ask(CreateLayer{.layer = layer}); !created)
                    return tl::unexpected(created.error());
            }
            layers.insert(layer);
        }
        return joinLayers(*into_, layers);
    }

    /// Merges with the newest revision of the main line.
    Result<void> mergeNewest() {
        Revision read = session_.revision;
        for (;;) {
            const Revision now = into_->session().revision();
            if (into_->base() <= session_.revision) {
                auto added = eachCommit(*into_, read, now, [&](const Commit& commit) {
                    return merge_->addInto(commit);
                });
                if (!added) return added;
            }
            read = now;
            for (const LayerId& layer : merge_->changed())
                if (const LayerDoc* content = into_->session().view(layer);
                    content && !(*content == merge_->into().at(layer)))
                    merge_->setInto(layer, *content);
            auto merged = merge_->merge(
                [&](const MergeConflict& conflict) { return decided(options_, conflict); });
            if (!merged) return tl::unexpected(merged.error());
            merged_ = *std::move(merged);
            const Commit edits = commitOf(merged_.edits);
            if (!options_.dryRun || options_.json)
                if (auto here = from_->fetchBlobs(edits); !here) return here;
            // Others may have committed meanwhile.
            if (options_.dryRun || into_->session().revision() == now) return {};
        }
    }

    Result<void> finish() {
        const auto undecided = std::ranges::count(merged_.decisions, Side::Undecided);
        Revision revision = 0;
        if (!options_.dryRun && undecided == 0 && !merged_.edits.empty()) {
            const auto done = submitEdits(*into_, merged_.edits, "Merge " + options_.name);
            if (!done) return tl::unexpected(done.error());
            revision = *done;
        }
        print(revision, std::size_t(undecided));
        if (options_.dryRun) return {};
        if (undecided > 0)
            return fail(ErrorCode::InvalidArgument,
                        "nothing was merged: " + counted(std::size_t(undecided), "conflict") +
                            (undecided == 1 ? " is" : " are") +
                            " not decided. Say --take main or --take session for all, --main PATH "
                            "or --session PATH for some");
        if (options_.keep) return {};
        (void)from_->step();
        if (const Revision newest = from_->session().revision(); newest > read_)
            return fail(ErrorCode::InvalidArgument,
                        "the session was merged as it was at " + inRevision(read_) + ". It is at " +
                            inRevision(newest) + " by now, and goes on: merge again");
        const auto ended = client::changeLiveSession(
            options_.target.server, options_.name, "end", user_, kSessionTimeout,
            revision > 0 ? revision : into_->session().revision());
        if (!ended)
            return fail(ended.error().code,
                        "the changes are merged, and the live session could not be ended: " +
                            ended.error().message);
        return checkNothingCameLate();
    }

    /// Somebody may have edited the session until it ended. The server sends every commit before it
    /// closes the connection.
    Result<void> checkNothingCameLate() {
        const auto end = std::chrono::steady_clock::now() + kSessionTimeout;
        while (from_->step() && std::chrono::steady_clock::now() < end) {
        }
        if (from_->session().revision() == read_) return {};
        return fail(ErrorCode::InvalidArgument,
                    "the session was merged as it was at " + inRevision(read_) +
                        ", and somebody edited it until it ended. usdlive session restore opens it "
                        "again: then merge again");
    }

    void print(Revision revision, std::size_t undecided) const {
        if (options_.json) return printJson(revision);
        const std::string name = withoutControls(options_.name);
        std::set<LayerId> layers;
        for (const auto& edit : merged_.edits) layers.insert(edit.layer);
        std::string names;
        for (const LayerId& layer : layers) names += (names.empty() ? "" : ", ") + layer.value;
        for (std::size_t index = 0; index < merged_.conflicts.size(); ++index)
            std::cout << nameOf(merged_.decisions[index]) << "  "
                      << conflictText(merged_.conflicts[index]) << "\n";
        if (merged_.dropped > 0)
            std::cout << counted(merged_.dropped, "edit")
                      << " of specs that are not in the main line: they are left out, too\n";
        if (merged_.edits.empty())
            std::cout << name << " has nothing to be merged\n";
        else if (options_.dryRun || undecided > 0)
            std::cout << "would be merged: " << counted(merged_.edits.size(), "edit") << " of "
                      << names << "\n";
        else
            std::cout << "merged " << name << " into " << names << ": "
                      << counted(merged_.edits.size(), "edit") << ", " << inRevision(revision)
                      << "\n";
        if (!options_.dryRun) return;
        for (const LayerId& layer : created_)
            std::cout << "    " << layer.value << "  is created\n";
        for (const Edit& edit : commitOf(merged_.edits).edits)
            std::cout << "    " << edit.layer.value << "  " << describe(edit) << "\n";
    }

    void printJson(Revision revision) const {
        Json json{{"merged", merged_.edits.size()},
                  {"dryRun", options_.dryRun},
                  {"dropped", merged_.dropped}};
        if (revision > 0) json["revision"] = revision;
        json["edits"] = toJson(commitOf(merged_.edits), {}, *into_)["edits"];
        json["created"] = Json::array();
        for (const LayerId& layer : created_) json["created"].push_back(layer.value);
        json["conflicts"] = Json::array();
        for (std::size_t index = 0; index < merged_.conflicts.size(); ++index)
            json["conflicts"].push_back(
                toJson(merged_.conflicts[index], merged_.decisions[index], *into_));
        std::cout << line(json);
    }

    const SessionOptions& options_;
    client::ListedLiveSession session_;
    Revision read_ = 0;  // the newest revision of the session that is merged
    UserName user_;
    std::unique_ptr<Link> from_, into_;  // the merged one, and the main line
    std::optional<client::LineMerge> merge_;
    client::LineMerge::Merged merged_;
    std::set<LayerId> created_;  // layers that the main line lacks
};

}  // namespace

Result<void> liveSession(const SessionOptions& options) {
    if (options.verb == "list") return listSessions(options);
    if (options.verb == "merge") return Merging(options).run();
    return changeSession(options);
}

}  // namespace usdlive::cli
