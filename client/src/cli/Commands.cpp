#include "Commands.h"

#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstring>
#include <deque>
#include <filesystem>
#include <iostream>
#include <optional>

#include "Link.h"
#include "Text.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::cli {

namespace {

namespace event = client::event;

constexpr double kTimeoutMs = 10'000;
constexpr std::size_t kEditsShown = 8;  // of one commit
constexpr Revision kLogPage = 1000;

volatile std::sig_atomic_t interrupted = 0;

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
    auto layer = (*link)->fetch(LayerId{address->layer}, options.revision);
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

}  // namespace

Result<void> list(const std::string& url) {
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    std::vector<std::string> names;
    for (const auto& info : reached->link->welcome().layers) names.push_back(info.layer.value);
    std::sort(names.begin(), names.end());
    for (const auto& name : names) std::cout << name << "\n";
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

Result<void> save(const std::string& url, const std::vector<std::string>& layers) {
    std::vector<LayerId> ids;
    for (const auto& name : layers) {
        auto id = parseLayerId(name);
        if (!id) return tl::unexpected(id.error());
        ids.push_back(std::move(*id));
    }
    const auto reached = reach(url);
    if (!reached) return tl::unexpected(reached.error());
    if (!reached->server.layer.empty()) ids.push_back({reached->server.layer});
    reached->link->session().save(std::move(ids));

    std::optional<LayersSaved> outcome;
    std::optional<Error> error;
    const auto ran = reached->link->run([&](const std::vector<client::Event>& events) {
        for (const auto& one : events) {
            if (const auto* saved = std::get_if<event::Saved>(&one)) outcome = saved->outcome;
            if (const auto* told = std::get_if<event::ServerError>(&one))
                error = Error{errorFromName(told->message.code).value_or(ErrorCode::Internal),
                              told->message.message};
        }
        return outcome || error;
    });
    if (!ran) return ran;
    if (!outcome) return tl::unexpected(*error);
    for (const auto& layer : outcome->saved) std::cout << "saved " << layer.value << "\n";
    for (const auto& failure : outcome->failed)
        std::cerr << "usdlive: " << failure.layer.value << ": " << failure.message << "\n";
    if (outcome->saved.empty() && outcome->failed.empty()) std::cout << "nothing to save\n";
    if (outcome->failed.empty()) return {};
    return fail(ErrorCode::SaveFailed,
                std::to_string(outcome->failed.size()) + " of " +
                    std::to_string(outcome->failed.size() + outcome->saved.size()) +
                    " layers were not saved");
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
