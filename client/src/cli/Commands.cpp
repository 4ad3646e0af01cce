// Implements the verbs of `usdlive`.
#include "cli/Commands.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <deque>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "cli/Json.h"
#include "cli/Link.h"
#include "cli/Reach.h"
#include "cli/Terminal.h"
#include "cli/Text.h"
#include "lines/LineEdits.h"
#include "usdlive/common/fetch/IssuerSignIn.h"
#include "usdlive/common/fetch/Join.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/KitLockMap.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"
#include "usdlive/common/net/KnownServers.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::cli {

namespace {

namespace event = client::event;

constexpr std::chrono::milliseconds kLookAround{1'000};
constexpr std::chrono::milliseconds kProjectsTime{10'000};

volatile std::sig_atomic_t interrupted = 0;

std::int64_t wallClockMs() {
    using namespace std::chrono;
    return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

struct Fetched {
    std::unique_ptr<Link> link;
    LayerId id;
    client::HistoryReader::Content layer;
};

Result<Fetched> fetch(const CatOptions& options) {
    auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const auto id = chosenLayer(**link, options);
    if (!id) return tl::unexpected(id.error());
    const auto revision = options.checkpoint.empty() ? Result<Revision>(options.revision)
                                                     : revisionOf(**link, options.checkpoint);
    if (!revision) return tl::unexpected(revision.error());
    auto layer = (*link)->readLayer(*id, *revision);
    if (!layer) return tl::unexpected(layer.error());
    return Fetched{std::move(*link), *id, std::move(*layer)};
}

/// Prints commits in order. With JSON, a commit waits for its big values.
class Watcher {
public:
    Watcher(Link& link, CommitView view) : link_(link), view_(std::move(view)) {}

    void add(const Commit& commit) {
        if (!concerns(commit, view_.layer)) return;
        waiting_.push_back({commit, {}});
        if (!view_.json) return;
        for (const Edit& edit : commit.edits)
            forEachBlob(edit.action, [&](const Value& blob) { want(blob.hash()); });
    }
    /// Call when the server does not have a big value.
    void failed(const Hash& hash) {
        for (Waiting& waiting : waiting_) waiting.blobs.erase(hash);
    }
    void print() {
        for (; !waiting_.empty(); waiting_.pop_front()) {
            Waiting& first = waiting_.front();
            std::erase_if(first.blobs,
                          [&](const Hash& hash) { return link_.blob(hash) != nullptr; });
            if (!first.blobs.empty()) break;
            std::cout << view_.text(first.commit, link_);
        }
        std::cout.flush();
    }

private:
    struct Waiting {
        Commit commit;
        std::set<Hash> blobs;
    };

    void want(const Hash& hash) {
        if (link_.blob(hash)) return;
        waiting_.back().blobs.insert(hash);
        link_.session().requestBlob(hash);
    }

    Link& link_;
    CommitView view_;
    std::deque<Waiting> waiting_;
};

Result<void> listDdsProjects(bool json) {
    const auto settings = client::ddsSettings();
    if (!settings) return tl::unexpected(settings.error());
    const auto projects = client::listDdsProjects(*settings, kLookAround);
    if (!projects) return tl::unexpected(projects.error());
    Json all = Json::array();
    for (const auto& project : *projects) {
        client::ServerAddress address;
        address.dds = true;
        address.project = project.name;
        if (json)
            all.push_back({{"project", project.name},
                           {"url", address.url()},
                           {"webSocket", project.url},
                           {"revision", project.revision}});
        else
            std::cout << address.url() << "\t" << project.url << "\trevision " << project.revision
                      << "\n";
    }
    if (json) std::cout << line(all);
    return {};
}

Result<void> listProjects(const client::ServerAddress& server, const client::ListedProjects& found,
                          bool json) {
    Json all = Json::array();
    std::size_t longest = 0;
    const auto urlOf = [&](const client::ListedProject& project) {
        client::ServerAddress address = server;
        address.project = project.name;
        return address.url();
    };
    for (const auto& project : found.all) longest = std::max(longest, urlOf(project).size());
    for (const auto& project : found.all) {
        const std::string url = urlOf(project);
        if (json) {
            Json one{{"project", project.name},
                     {"url", url},
                     {"status", project.status},
                     {"revision", project.revision},
                     {"sessions", project.sessions}};
            if (!project.reason.empty()) one["reason"] = project.reason;
            all.push_back(std::move(one));
            continue;
        }
        std::cout << url << std::string(longest - url.size() + 2, ' ');
        if (project.status == "ok")
            std::cout << "revision " << project.revision << ", " << project.sessions
                      << (project.sessions == 1 ? " session" : " sessions");
        else
            std::cout << withoutControls(project.status +
                                         (project.reason.empty() ? "" : ": " + project.reason));
        std::cout << "\n";
    }
    if (json) std::cout << line(all);
    return {};
}

using MakeEdits = std::function<std::vector<EditAction>(const LayerDoc&)>;

/// Opens a layer and commits edits of its pseudo-root. Returns false if there was nothing to
/// commit.
Result<bool> editRoot(Link& link, const LayerId& layer, const MakeEdits& makeEdits) {
    if (auto joined = joinLayers(link, {layer}); !joined) return tl::unexpected(joined.error());
    std::vector<client::AuthoredEdit> edits;
    for (EditAction& action : makeEdits(*link.session().view(layer)))
        edits.push_back({layer, "/", std::move(action)});
    if (edits.empty()) return false;
    if (auto done = submitEdits(link, std::move(edits)); !done) return tl::unexpected(done.error());
    return true;
}

/// Everything in a layer that prevents others from editing: its lock (LK1), and in a root layer the
/// locks of specs (LK5), Kit's locks of layers, and mutes (MU1).
struct Blockades {
    LayerLock lock;
    std::vector<EditAction> lockMap;
    SpecLocks specs;
    std::set<LayerId> muted;

    static Blockades of(const LayerId& layer, const LayerDoc& doc) {
        return {lockOf(doc), kitLockMapEdits(doc), specLocksOf(doc), globallyMuted(layer, doc)};
    }
    [[nodiscard]] std::vector<EditAction> edits(const LayerId& layer, const LayerDoc& doc) const {
        auto edits = lockEdits(doc, LayerLock{});
        edits.insert(edits.end(), lockMap.begin(), lockMap.end());
        for (const auto& [path, owner] : specs) edits.push_back(specUnlockEdit(path));
        for (const LayerId& one : muted)
            for (EditAction& edit : globalMuteEdits(layer, doc, one, false))
                edits.push_back(std::move(edit));
        return edits;
    }
    /// Describes the removed entries: "the lock of ada, 2 locks of specs, 1 mute".
    [[nodiscard]] std::string text() const {
        std::string text;
        const auto add = [&](const std::string& part) {
            text += (text.empty() ? "" : ", ") + part;
        };
        const auto counted = [](std::size_t count, const std::string& one, const char* many) {
            return std::to_string(count) + " " + (count == 1 ? one : many);
        };
        if (lock.locked)
            add(lock.holder.empty() ? "a lock without holder" : "the lock of " + lock.holder.value);
        if (!lockMap.empty())
            add(counted(lockMap.size(), "layer lock of Kit", "layer locks of Kit"));
        if (!specs.empty()) add(counted(specs.size(), "lock of a spec", "locks of specs"));
        if (!muted.empty()) add(counted(muted.size(), "mute", "mutes"));
        return text;
    }
};

/// Reports the result for each layer: one sentence per line, or one JSON array of {layer, changed,
/// ...}.
class Report {
public:
    explicit Report(bool json) : json_(json) {}

    void add(const LayerId& layer, bool changed, const std::string& sentence) {
        if (json_)
            all_.push_back({{"layer", layer.value}, {"changed", changed}, {"message", sentence}});
        else
            std::cout << sentence << "\n";
    }
    ~Report() {
        if (json_) std::cout << line(all_);
    }
    Report(const Report&) = delete;
    Report& operator=(const Report&) = delete;

private:
    bool json_;
    Json all_ = Json::array();
};

/// Asks the server to do something with the files of layers, and prints the answer. `done`: the
/// layers in it that the verb worked for.
template <class Request, class Done>
Result<void> askForFiles(const Common& options, Request request, const std::string& verb,
                         Done done) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    request.layers = options.target.layers;
    const auto answer = (*link)->ask(std::move(request));
    if (!answer) return tl::unexpected(answer.error());
    const std::vector<LayerId>& layers = (*answer).*done;
    const auto& failed = answer->failed;
    if (options.json) {
        std::cout << line(answerToJson(*answer));
    } else {
        for (const auto& layer : layers) std::cout << verb << " " << layer.value << "\n";
        if (layers.empty() && failed.empty()) std::cout << "nothing to be " << verb << "\n";
    }
    for (const auto& failure : failed)
        std::cerr << "usdlive: " << failure.layer.value << ": " << failure.message << "\n";
    if (failed.empty()) return {};
    return fail(ErrorCode::SaveFailed, std::to_string(failed.size()) + " of " +
                                           std::to_string(failed.size() + layers.size()) +
                                           " layers were not " + verb);
}

/// Lists the files that are not served (FI5).
Result<void> listSkipped(Link& link, bool json) {
    return link.ask(ListSkipped{}).map([&](const SkippedFiles& skipped) {
        if (json) std::cout << line(answerToJson(skipped)["files"]);
        if (!json)
            for (const SkippedFile& file : skipped.files) std::cout << describe(file) << "\n";
        if (skipped.count > skipped.files.size())
            std::cerr << "usdlive: " << skipped.count - skipped.files.size()
                      << " more files are skipped\n";
    });
}

// Waits for the layer states and presences, which the server sends before the answer to any
// request.
Result<void> waitForStates(Link& link) {
    return link.readLog(link.welcome().revision, link.welcome().revision).map([](const auto&) {});
}

}  // namespace

Result<void> list(const ListOptions& options) {
    const client::ServerAddress& server = options.target.server;
    if (server.dds && server.project.empty()) return listDdsProjects(options.json);
    if (!server.dds && server.project.empty() && !options.skipped) {
        const auto projects = client::listProjects(server, kProjectsTime);
        if (projects && projects->areSeveral) return listProjects(server, *projects, options.json);
    }
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    if (options.skipped) return listSkipped(**link, options.json);
    const std::set<LayerId> layers = (*link)->session().projectLayers();
    (void)waitForStates(**link);  // a server without history sends no states; the names are enough
    const auto& known = (*link)->session().layerStates();
    const Palette palette = Palette::of(STDOUT_FILENO);
    Json all = Json::array();
    for (const LayerId& layer : layers) {
        const auto found = known.find(layer);
        LayerState state;
        state.layer = layer;
        if (found != known.end()) state = found->second;
        if (options.json)
            all.push_back(toJson(state));
        else
            std::cout << layer.value << (options.states ? describe(state, palette) : "") << "\n";
    }
    if (options.json) std::cout << line(all);
    return {};
}

Result<void> who(const Common& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    (void)waitForStates(**link);
    Json all = Json::array();
    for (const auto& [client, presence] : (*link)->session().presences())
        if (options.json)
            all.push_back(toJson(presence));
        else
            std::cout << describe(presence, Palette::of(STDOUT_FILENO)) << "\n";
    if (options.json) std::cout << line(all);
    return {};
}

Result<void> cat(const CatOptions& options) {
    const auto fetched = fetch(options);
    if (!fetched) return tl::unexpected(fetched.error());
    if (auto here = fetched->link->fetchBlobs(fetched->layer.doc); !here) return here;
    if (options.json) {
        Json json{{"layer", fetched->id.value}, {"revision", fetched->layer.revision}};
        json.update(toJson(fetched->layer.doc, *fetched->link));
        std::cout << line(json);
        return {};
    }
    const auto text = usd::exportText(fetched->layer.doc, *fetched->link);
    if (!text) return tl::unexpected(text.error());
    std::cout << *text;
    return {};
}

Result<void> tree(const CatOptions& options) {
    const auto fetched = fetch(options);
    if (!fetched) return tl::unexpected(fetched.error());
    if (options.json)
        std::cout << line(treeToJson(fetched->layer.doc));
    else
        std::cout << describeTree(fetched->layer.doc, Palette::of(STDOUT_FILENO));
    return {};
}

Result<void> watch(const Common& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const auto layer = chosenLayer(**link, options);
    if (!layer) return tl::unexpected(layer.error());
    for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { interrupted = 1; });

    Watcher watcher(**link, CommitView{*layer, kEditsShown, options.json});
    bool lost = false;
    while (!interrupted && std::cout) {
        const auto events = (*link)->step();
        if (!events) {
            if (!std::exchange(lost, true))
                std::cerr << "usdlive: " << events.error().message << "\n";
            continue;
        }
        for (const auto& one : *events) {
            if (std::holds_alternative<event::Connected>(one) && std::exchange(lost, false))
                std::cerr << "usdlive: connected again\n";
            if (const auto* committed = std::get_if<event::Committed>(&one))
                watcher.add(committed->commit);
            if (const auto* error = std::get_if<event::ServerError>(&one);
                error && error->message.blob)
                watcher.failed(*error->message.blob);
        }
        watcher.print();
    }
    return {};
}

Result<void> setLocked(const Common& options, bool locked) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const auto user = userOf(options);
    if (!user) return tl::unexpected(user.error());
    Report report(options.json);
    for (const LayerId& layer : options.target.layers) {
        const auto changed = editRoot(**link, layer, [&](const LayerDoc& doc) {
            return lockEdits(doc, locked ? LayerLock{true, *user, wallClockMs()} : LayerLock{});
        });
        if (!changed) return tl::unexpected(changed.error());
        if (locked)
            report.add(
                layer, *changed,
                layer.value + (*changed ? " is" : " was already") + " locked by " + user->value);
        else
            report.add(layer, *changed,
                       layer.value + (*changed ? " is unlocked" : " was not locked"));
    }
    return {};
}

Result<void> unlockAll(const Common& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const std::set<LayerId> layers = (*link)->session().projectLayers();
    Report report(options.json);
    std::size_t cleared = 0, failed = 0;
    for (const LayerId& layer : layers) {
        Blockades found;
        const auto changed = editRoot(**link, layer, [&](const LayerDoc& doc) {
            found = Blockades::of(layer, doc);
            return found.edits(layer, doc);
        });
        (*link)->session().closeLayer(layer);
        if (!changed && !(*link)->session().isConnected()) return tl::unexpected(changed.error());
        if (!changed) {
            ++failed;
            std::cerr << "usdlive: " << layer.value << ": " << changed.error().message << "\n";
        } else if (*changed) {
            ++cleared;
            report.add(layer, true, layer.value + ": ended " + found.text());
        }
    }
    if (cleared == 0 && failed == 0 && !options.json)
        std::cout << "nothing is locked or muted in " << layers.size() << " layers\n";
    if (failed == 0) return {};
    return fail(
        ErrorCode::Locked,
        std::to_string(failed) + " of " + std::to_string(layers.size()) +
            " layers were not changed. Only administrators can remove the locks of others: serve "
            "with --admin " +
            userOf(options).value_or(UserName{"USER"}).value +
            ", or give the role admin (usdlive user role)");
}

Result<void> setMuted(const MuteOptions& options, bool muted) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    const LayerId& root = options.root;
    const std::string where = " on the stages of " + root.value;
    Report report(options.json);
    for (const LayerId& layer : options.target.layers) {
        bool unknown = false;
        const auto changed = editRoot(**link, root, [&](const LayerDoc& doc) {
            const bool already = globallyMuted(root, doc).contains(layer);
            unknown = !already && !hasLayer(**link, layer);
            if (unknown || already == muted) return std::vector<EditAction>();
            return globalMuteEdits(root, doc, layer, muted);
        });
        if (!changed) return tl::unexpected(changed.error());
        if (unknown) return tl::unexpected(noSuchLayer(layer));
        const std::string done = muted ? (*changed ? " is muted" : " was already muted")
                                       : (*changed ? " is no longer muted" : " was not muted");
        report.add(layer, *changed, layer.value + done + where);
    }
    return {};
}

Result<void> save(const SaveOptions& options) {
    const auto force = options.force ? std::optional(true) : std::nullopt;
    return askForFiles(options, SaveLayers{.force = force}, "saved", &LayersSaved::saved);
}

Result<void> reload(const Common& options) {
    return askForFiles(options, ReloadLayers{}, "reloaded", &LayersReloaded::reloaded);
}

Result<void> upload(const UploadOptions& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    return (*link)->upload(options.file, options.path, options.overwrite).map([&] {
        if (options.json)
            std::cout << line(nlohmann::json{{"uploaded", options.path}});
        else
            std::cout << "uploaded " << options.path << "\n";
    });
}

Result<void> createCheckpoint(const CheckpointOptions& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    return (*link)
        ->ask(CreateCheckpoint{.name = options.name})
        .map([&](const CheckpointCreated& created) {
            std::cout << (options.json ? line(answerToJson(created)["checkpoint"])
                                       : describe(created.checkpoint, Palette::of(STDOUT_FILENO)));
        });
}

Result<void> listCheckpoints(const Common& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    return (*link)->ask(ListCheckpoints{}).map([&](const Checkpoints& all) {
        if (options.json) std::cout << line(answerToJson(all)["checkpoints"]);
        if (!options.json)
            for (const Checkpoint& checkpoint : all.checkpoints)
                std::cout << describe(checkpoint, Palette::of(STDOUT_FILENO));
    });
}

Result<void> compact(const CompactOptions& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    return (*link)
        ->ask(CompactHistory{.days = options.days})
        .map([&](const HistoryCompacted& done) {
            std::cout << (options.json ? line(answerToJson(done)) : describe(done));
        });
}

Result<void> stat(const Common& options) {
    const auto link = reach(options);
    if (!link) return tl::unexpected(link.error());
    return (*link)->ask(RequestStorage{}).map([&](const Storage& storage) {
        std::cout << (options.json ? line(answerToJson(storage))
                                   : describe(storage, Palette::of(STDOUT_FILENO)));
    });
}

Result<void> login(const ServerOnly& options) {
    const auto& server = options.server;
    const auto show = [&](const fetch::DevicePrompt& prompt) {
        std::cout << "Sign in at " << server.hostAndPort() << " with " << prompt.issuer
                  << ". Open\n\n  " << prompt.address << "\n\non any machine, and enter the code "
                  << prompt.code << ". It is valid for " << prompt.time.count() / 60
                  << " minutes.\n";
        if (!prompt.completeAddress.empty())
            std::cout << "Or open this, which has the code: " << prompt.completeAddress << "\n";
        std::cout << "Enter a code only if you have started this command yourself.\n" << std::flush;
    };
    return fetch::login(server.host, server.port, server.isSecure, show)
        .map([](const fetch::JoinedServer& joined) {
            std::cout << "You are " << joined.user << " at " << joined.url
                      << " from now on, in all programs of this account.\n";
        });
}

Result<void> forget(const ServerOnly& options) {
    const std::string server = options.server.hostAndPort();
    const auto wasKnown = KnownServers().forget(options.server.host, options.server.port);
    if (!wasKnown) return tl::unexpected(wasKnown.error());
    std::cout << (*wasKnown ? "forgot the certificate and the token of "
                            : "nothing is known about ")
              << server << "\n";
    return {};
}

Result<void> join(const std::string& text) {
    std::string pasted = text;
    if (pasted.empty()) {
        if (isatty(STDIN_FILENO) != 0) std::cout << "Paste the invitation: " << std::flush;
        std::getline(std::cin, pasted);
    }
    const auto invitation = parseInvitation(pasted);
    if (!invitation) return tl::unexpected(invitation.error());
    return fetch::join(*invitation).map([](const fetch::JoinedServer& joined) {
        std::cout << "You are " << joined.user << " at " << joined.url
                  << " from now on, in all programs of this account.\n";
    });
}

Error runServer(char** arguments) {
    std::error_code ignored;
    const auto self = std::filesystem::read_symlink("/proc/self/exe", ignored);
    const std::string server = (self.parent_path() / "usdlive-server").string();
    std::string name = "usdlive " + std::string(arguments[0]);  // used in its help and errors
    arguments[0] = name.data();
    execv(server.c_str(), arguments);
    return {ErrorCode::Internal, "cannot start " + server + ": " + std::strerror(errno)};
}

Error runPage(char** arguments) {
    std::error_code ignored;
    const auto self = std::filesystem::read_symlink("/proc/self/exe", ignored);
    // A build has the package beside the folder of the programs; an installed one is known to its
    // Python.
    const auto built = self.parent_path().parent_path() / "python";
    if (std::filesystem::exists(built / "usdlive", ignored)) {
        const char* before = std::getenv("PYTHONPATH");
        ::setenv("PYTHONPATH",
                 (built.string() + (before && *before ? std::string(":") + before : "")).c_str(),
                 1);
    }
    const char* given = std::getenv("USDLIVE_PYTHON");
    std::string python = given && *given ? given : "python3";
    std::vector<std::string> words{python, "-m", "usdlive.page"};
    while (*++arguments) words.emplace_back(*arguments);
    std::vector<char*> all;
    for (std::string& word : words) all.push_back(word.data());
    all.push_back(nullptr);
    execvp(python.c_str(), all.data());
    return {ErrorCode::Internal, "cannot start " + python + ": " + std::strerror(errno) +
                                     ". USDLIVE_PYTHON names the Python that has usdlive"};
}

}  // namespace usdlive::cli
