#include "Commands.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <deque>
#include <filesystem>
#include <iostream>
#include <optional>

#include "Link.h"
#include "Text.h"
#include "usdlive/client/transport/SystemUser.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::cli {

namespace {

namespace event = client::event;

constexpr double kTimeoutMs = 10'000;
constexpr std::chrono::milliseconds kLookAround{1'000};
constexpr std::size_t kEditsShown = 8;  // of one commit
constexpr Revision kLogPage = 1000;

volatile std::sig_atomic_t interrupted = 0;

std::int64_t wallClockMs() {
    using namespace std::chrono;
    return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

struct Reached {
    client::ServerAddress server;
    std::unique_ptr<Link> link;
};

Result<Reached> reach(const std::string& url) {
    auto address = client::parseServerAddress(url);
    if (!address) return tl::unexpected(address.error());
    auto link = Link::connect(*address, kTimeoutMs);
    if (!link) return tl::unexpected(link.error());
    return Reached{std::move(*address), std::move(*link)};
}

// `--layer` or the layer in the URL; empty: all.
Result<LayerId> chosenLayer(const client::ServerAddress& server, const std::string& option) {
    if (option.empty()) return LayerId{server.layer};
    return parseLayerId(option);
}

Result<void> knows(const Link& link, const LayerId& layer) {
    const auto& layers = link.welcome().layers;
    const auto same = [&](const LayerInfo& info) { return info.layer == layer; };
    if (layer.empty() || std::any_of(layers.begin(), layers.end(), same)) return {};
    return fail(ErrorCode::LayerNotFound, "the project has no layer " + layer.value);
}

/// Waits for what answers a request, or for what is wrong with it.
template <class Answer>
Result<Answer> answer(Link& link) {
    std::optional<Answer> answer;
    std::optional<Error> error;
    const auto ran = link.run([&](const std::vector<client::Event>& events) {
        for (const auto& one : events) {
            if (const auto* told = std::get_if<Answer>(&one)) answer = *told;
            if (const auto* told = std::get_if<event::ServerError>(&one))
                error = Error{errorFromName(told->message.code).value_or(ErrorCode::Internal),
                              told->message.message};
        }
        return answer || error;
    });
    if (!ran) return tl::unexpected(ran.error());
    if (!answer) return tl::unexpected(*error);
    return *std::move(answer);
}

Result<std::vector<Checkpoint>> checkpoints(Link& link) {
    link.session().listCheckpoints();
    return answer<event::CheckpointsListed>(link).map(
        [](event::CheckpointsListed&& listed) { return std::move(listed.answer.checkpoints); });
}

Result<Revision> chosenRevision(Link& link, const CatOptions& options) {
    if (options.checkpoint.empty()) return options.revision;
    const auto all = checkpoints(link);
    if (!all) return tl::unexpected(all.error());
    const auto found = std::ranges::find(*all, options.checkpoint, &Checkpoint::name);
    if (found == all->end())
        return fail(ErrorCode::InvalidArgument,
                    "the project has no checkpoint '" + options.checkpoint + "'");
    return found->revision;
}

struct Fetched {
    std::unique_ptr<Link> link;
    Link::Layer layer;
};

Result<Fetched> fetch(const CatOptions& options) {
    auto address = client::parseServerAddress(options.url);
    if (!address) return tl::unexpected(address.error());
    if (address->layer.empty())
        return fail(ErrorCode::InvalidArgument, "name a layer after the server: " + options.url +
                                                    (options.url.ends_with('/') ? "" : "/") +
                                                    "LAYER");
    auto link = Link::connect(*address, kTimeoutMs);
    if (!link) return tl::unexpected(link.error());
    const auto revision = chosenRevision(**link, options);
    if (!revision) return tl::unexpected(revision.error());
    auto layer = (*link)->fetch(LayerId{address->layer}, *revision);
    if (!layer) return tl::unexpected(layer.error());
    return Fetched{std::move(*link), std::move(*layer)};
}

void show(const Commit& commit, std::size_t maxEdits, const LayerId& layer, bool json) {
    std::cout << (json ? asJson(commit, layer) + "\n" : describe(commit, maxEdits, layer));
}

Result<std::vector<Commit>> readLog(Link& link, Revision from, Revision to) {
    std::vector<Commit> commits;
    std::optional<Result<void>> done;
    link.session().requestLog(
        from, to, [&](const Commit& commit) { commits.push_back(commit); },
        [&](Result<void> result) { done = std::move(result); });
    const auto ran = link.run([&](const auto&) { return done.has_value(); });
    if (!ran && !done) return tl::unexpected(ran.error());
    if (!*done) return tl::unexpected(done->error());
    return commits;
}

// The latest `limit` commits of the layer, oldest first: page by page from the end.
Result<void> showLatest(Link& link, const LogOptions& options, const LayerId& layer,
                        std::size_t maxEdits) {
    std::deque<std::string> texts;
    for (Revision to = link.welcome().revision; to > 0 && texts.size() < options.limit;) {
        const Revision page =
            layer.empty() ? std::min<Revision>(kLogPage, options.limit) : kLogPage;
        const Revision from = to > page ? to - page + 1 : 1;
        const auto commits = readLog(link, from, to);
        if (!commits) return tl::unexpected(commits.error());
        for (auto commit = commits->rbegin(); commit != commits->rend(); ++commit)
            if (concerns(*commit, layer) && texts.size() < options.limit)
                texts.push_front(options.json ? asJson(*commit, layer) + "\n"
                                              : describe(*commit, maxEdits, layer));
        to = from - 1;
    }
    for (const auto& text : texts) std::cout << text;
    return {};
}

Result<void> showFrom(Link& link, const LogOptions& options, const LayerId& layer,
                      std::size_t maxEdits) {
    std::size_t shown = 0;
    const Revision newest = link.welcome().revision;
    if (options.from > newest)
        return fail(ErrorCode::FutureRevision,
                    "the project is at revision " + std::to_string(newest));
    for (Revision from = options.from; from <= newest && shown < options.limit; from += kLogPage) {
        const auto commits = readLog(link, from, std::min(from + kLogPage - 1, newest));
        if (!commits) return tl::unexpected(commits.error());
        for (const auto& commit : *commits)
            if (concerns(commit, layer) && shown++ < options.limit)
                show(commit, maxEdits, layer, options.json);
    }
    return {};
}

Result<void> listProjects() {
    const auto settings = client::ddsSettings();
    if (!settings) return tl::unexpected(settings.error());
    const auto projects = client::listDdsProjects(*settings, kLookAround);
    if (!projects) return tl::unexpected(projects.error());
    for (const auto& project : *projects) {
        client::ServerAddress address;
        address.dds = true;
        address.project = project.name;
        std::cout << address.url() << "\t" << project.url << "\trevision " << project.revision
                  << "\n";
    }
    return {};
}

/// Opens the layer that the URL names and commits edits of its pseudo-root.
Result<void> editRoot(
    const std::string& url,
    const std::function<std::vector<EditAction>(const LayerId&, const LayerDoc&)>& makeEdits) {
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    const LayerId layer{reached->server.layer};
    if (layer.empty())
        return fail(ErrorCode::InvalidArgument, "name a layer after the server: " + url);
    Link& link = *reached->link;
    std::optional<Error> failed;
    const auto ran = [&](const auto& done) {
        return link.run([&](const std::vector<client::Event>& events) {
            for (const auto& one : events) {
                if (const auto* lost = std::get_if<event::Lost>(&one)) failed = lost->work.reason;
                if (const auto* join = std::get_if<event::JoinFailed>(&one)) failed = join->reason;
            }
            return failed || done();
        });
    };
    link.session().openLayer(layer);
    if (auto joined = ran([&] { return link.session().isJoined(layer); }); !joined) return joined;
    if (failed) return tl::unexpected(*failed);
    std::vector<client::AuthoredEdit> edits;
    for (EditAction& action : makeEdits(layer, *link.session().view(layer)))
        edits.push_back({layer, "/", std::move(action)});
    if (edits.empty()) return {};
    link.session().author(std::move(edits));
    auto sent = ran([&] { return link.session().pendingTransactions() == 0; });
    if (sent && failed) return tl::unexpected(*failed);
    return sent;
}

/// Has the server do something with the files of layers.
template <class Answer, class Ask>
auto askForFiles(const std::string& url, const std::vector<std::string>& layers, Ask ask)
    -> Result<decltype(Answer::outcome)> {
    std::vector<LayerId> ids;
    for (const auto& name : layers) {
        auto id = parseLayerId(name);
        if (!id) return tl::unexpected(id.error());
        ids.push_back(std::move(*id));
    }
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    if (!reached->server.layer.empty()) ids.push_back({reached->server.layer});
    ask(reached->link->session(), std::move(ids));
    return answer<Answer>(*reached->link).map([](Answer&& told) {
        return std::move(told.outcome);
    });
}

Result<void> tellFiles(const std::string& verb, const std::vector<LayerId>& done,
                       const std::vector<LayersSaved::Failure>& failed) {
    for (const auto& layer : done) std::cout << verb << " " << layer.value << "\n";
    for (const auto& failure : failed)
        std::cerr << "usdlive: " << failure.layer.value << ": " << failure.message << "\n";
    if (done.empty() && failed.empty()) std::cout << "nothing to be " << verb << "\n";
    if (failed.empty()) return {};
    return fail(ErrorCode::SaveFailed, std::to_string(failed.size()) + " of " +
                                           std::to_string(failed.size() + done.size()) +
                                           " layers were not " + verb);
}

}  // namespace

Result<void> list(const std::string& url, bool states) {
    const auto address = client::parseServerAddress(url);
    if (!address) return tl::unexpected(address.error());
    if (address->dds && address->project.empty()) return listProjects();
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    std::vector<LayerId> layers;
    for (const auto& info : reached->link->welcome().layers) layers.push_back(info.layer);
    std::sort(layers.begin(), layers.end());
    (void)readLog(*reached->link, reached->link->welcome().revision,
                  reached->link->welcome().revision);
    const auto& known = reached->link->session().layerStates();
    for (const LayerId& layer : layers) {
        const auto state = known.find(layer);
        const bool told = states && state != known.end();
        std::cout << layer.value << (told ? describe(state->second) : "") << "\n";
    }
    return {};
}

Result<void> who(const std::string& url) {
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    // They are told before the answer to whatever is asked.
    (void)readLog(*reached->link, reached->link->welcome().revision,
                  reached->link->welcome().revision);
    for (const auto& [client, presence] : reached->link->session().presences())
        std::cout << describe(presence) << "\n";
    return {};
}

Result<void> cat(const CatOptions& options) {
    const auto fetched = fetch(options);
    if (!fetched) return tl::unexpected(fetched.error());
    if (auto here = fetched->link->fetchBlobs(fetched->layer.doc); !here) return here;
    const auto text = usd::exportText(fetched->layer.doc, *fetched->link);
    if (!text) return tl::unexpected(text.error());
    std::cout << *text;
    return {};
}

Result<void> tree(const CatOptions& options) {
    const auto fetched = fetch(options);
    if (!fetched) return tl::unexpected(fetched.error());
    std::cout << describeTree(fetched->layer.doc);
    return {};
}

Result<void> log(const LogOptions& options) {
    const auto reached = reach(options.url);
    if (!reached) return tl::unexpected(reached.error());
    const auto layer = chosenLayer(reached->server, options.layer);
    if (!layer) return tl::unexpected(layer.error());
    if (auto known = knows(*reached->link, *layer); !known) return known;
    const std::size_t maxEdits = options.all ? std::size_t(-1) : kEditsShown;
    return options.from == 0 ? showLatest(*reached->link, options, *layer, maxEdits)
                             : showFrom(*reached->link, options, *layer, maxEdits);
}

Result<void> watch(const WatchOptions& options) {
    const auto reached = reach(options.url);
    if (!reached) return tl::unexpected(reached.error());
    const auto layer = chosenLayer(reached->server, options.layer);
    if (!layer) return tl::unexpected(layer.error());
    if (auto known = knows(*reached->link, *layer); !known) return known;
    for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { interrupted = 1; });

    bool lost = false;
    while (!interrupted) {
        const auto events = reached->link->step();
        if (!events) {
            if (!std::exchange(lost, true))
                std::cerr << "usdlive: " << events.error().message << "\n";
            continue;
        }
        for (const auto& one : *events) {
            if (std::holds_alternative<event::Connected>(one) && std::exchange(lost, false))
                std::cerr << "usdlive: connected again\n";
            if (const auto* committed = std::get_if<event::Committed>(&one);
                committed && concerns(committed->commit, *layer))
                show(committed->commit, kEditsShown, *layer, options.json);
        }
        std::cout.flush();
    }
    return {};
}

Result<void> setLocked(const std::string& url, bool locked) {
    LayerLock lock;
    if (locked) lock = {true, client::systemUser(), wallClockMs()};
    return editRoot(url, [&](const LayerId&, const LayerDoc&) { return lockEdits(lock); });
}

Result<void> setMuted(const std::string& url, const std::string& layer, bool muted) {
    const auto id = parseLayerId(layer);
    if (!id) return tl::unexpected(id.error());
    return editRoot(url, [&](const LayerId& root, const LayerDoc& doc) {
        return globalMuteEdits(root, doc, *id, muted);
    });
}

Result<void> save(const std::string& url, const std::vector<std::string>& layers, bool force) {
    const auto outcome = askForFiles<event::Saved>(
        url, layers, [&](client::Session& session, std::vector<LayerId> ids) {
            session.save(std::move(ids), force);
        });
    if (!outcome) return tl::unexpected(outcome.error());
    return tellFiles("saved", outcome->saved, outcome->failed);
}

Result<void> reload(const std::string& url, const std::vector<std::string>& layers) {
    const auto outcome = askForFiles<event::Reloaded>(
        url, layers,
        [](client::Session& session, std::vector<LayerId> ids) { session.reload(std::move(ids)); });
    if (!outcome) return tl::unexpected(outcome.error());
    return tellFiles("reloaded", outcome->reloaded, outcome->failed);
}

Result<void> createCheckpoint(const std::string& url, const std::string& name) {
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    reached->link->session().createCheckpoint(name);
    return answer<event::CheckpointMade>(*reached->link).map([](const auto& made) {
        std::cout << describe(made.answer.checkpoint);
    });
}

Result<void> listCheckpoints(const std::string& url) {
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    return checkpoints(*reached->link).map([](const std::vector<Checkpoint>& all) {
        for (const Checkpoint& checkpoint : all) std::cout << describe(checkpoint);
    });
}

Error serve(char** arguments) {
    std::error_code ignored;
    const auto self = std::filesystem::read_symlink("/proc/self/exe", ignored);
    std::string server = (self.parent_path() / "usdlive-server").string();
    arguments[0] = server.data();
    execv(server.c_str(), arguments);
    return {ErrorCode::Internal, "cannot start " + server + ": " + std::strerror(errno)};
}

}  // namespace usdlive::cli
