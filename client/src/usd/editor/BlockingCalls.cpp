// The calls of a Client that wait for the server: loops around tick(), each with a time limit.
#include <algorithm>
#include <chrono>
#include <utility>

#include "basics/Clocks.h"
#include "usd/editor/ClientImpl.h"
#include "usd/live/EarlyWork.h"
#include "usdlive/common/core/LayerPath.h"

namespace usdlive {

namespace event = client::event;
namespace fs = std::filesystem;
using std::chrono::milliseconds;

namespace {

// Retries to reach a server for this time, because it may be starting. The longer time-out applies
// to a server that accepts the connection but does not answer.
constexpr double kRefusedMs = 1000;
// A call fails if a connected server sends nothing for this time.
constexpr double kSilenceMs = 60'000;
// The budget for each tick of a blocking call.
constexpr double kBlockingBudgetMs = 50;

}  // namespace

Result<void> Client::Impl::greet() {
    const Stopwatch watch;
    while (!session_.isConnected()) {
        if (line_.refused()) return tl::unexpected(*line_.refused());
        if (watch.ms() > options_.connectTimeoutMs) return tl::unexpected(line_.notThere(session_));
        if (line_.lastLoss() && !line_.isOpen() && watch.ms() > kRefusedMs)
            return tl::unexpected(*line_.lastLoss());
        line_.connection().wait(milliseconds(20));
        tick(kBlockingBudgetMs);
    }
    return {};
}

// --- opening and closing

Result<pxr::SdfLayerRefPtr> Client::Impl::openLayer(const LayerId& id, client::LoadSet load) {
    if (auto open = layer(id); open && layers_.hasUsed(id, load)) return open;
    const auto request = opens_.add(id, load, client::OpenRequests::Reports::Outcome);
    if (auto opened = waitForOpen(request); !opened) return tl::unexpected(opened.error());
    if (auto open = layer(id)) return open;
    return fail(ErrorCode::LayerNotOpen, id.value + " was closed while it was being opened");
}

Result<void> Client::Impl::waitForOpen(std::uint64_t request) {
    Stopwatch silent, unconnected;
    for (;;) {
        const auto steps = opens_.steps();
        const TickResult ticked = tick(kBlockingBudgetMs);
        if (auto outcome = opens_.takeOutcome(request)) return *outcome;
        if (session_.isConnected()) unconnected = Stopwatch();
        if (ticked.more || steps != opens_.steps() ||
            line_.connection().wait(milliseconds(ticked.filling ? 1 : 10)) || ticked.filling)
            silent = Stopwatch();
        const bool isLost = unconnected.ms() > options_.connectTimeoutMs;
        if (!isLost && silent.ms() <= kSilenceMs) continue;
        opens_.drop(request);
        if (isLost) return tl::unexpected(line_.notThere(session_));
        return fail(ErrorCode::NotConnected, "the server no longer answers");
    }
}

Result<pxr::SdfLayerRefPtr> Client::Impl::createLayer(const LayerId& id) {
    if (auto valid = parseLayerId(id.value); !valid) return tl::unexpected(valid.error());
    if (!session_.isConnected())
        return fail(ErrorCode::NotConnected,
                    "cannot create " + id.value +
                        " without a connection: only the server knows which names are free. Try "
                        "again when it is connected");
    const auto answer = answerTo(session_.request(CreateLayer{.layer = id}), kSilenceMs);
    if (!answer)
        return fail(ErrorCode::NotConnected, "the server did not report in time whether " +
                                                 id.value + " was created; it may exist");
    if (!*answer) return tl::unexpected(answer->error());
    return openLayer(id, client::LoadSet::All);
}

Result<void> Client::Impl::upload(const fs::path& file, const std::string& path, bool overwrite) {
    const auto number = uploads_.add(file, path, overwrite);
    return uploads_.finish(number, path, [this] {
        tick(kBlockingBudgetMs);
        return line_.connection().wait(milliseconds(1));
    });
}

Result<std::vector<LayerId>> Client::Impl::attach(const fs::path& projectFolder) {
    auto folder = client::FolderPlaces::create(projectFolder);
    if (!folder) return tl::unexpected(folder.error());
    const auto here = client::FolderPlaces::create(projectFolder);
    frame_.addProjectFolder((*folder)->folder());
    places_.attach(std::move(*folder));
    auto found = layers_.loadedHere();
    // The same layers may be loaded by their addresses, too.
    std::erase_if(found, [&](const auto& one) { return !here || !(*here)->layerOf(one.second); });
    for (const auto& [id, layer] : found) {
        if (layers_.isLiveElsewhere(layer))
            return tl::unexpected(client::OpenLayers::liveElsewhere(id));
        if (const auto work = client::earlyWork(layer, values_.cache()); !work || !work->empty())
            return fail(ErrorCode::InvalidArgument,
                        id.value + " has unsaved edits; save or reload it first");
    }
    std::vector<LayerId> ids;
    for (const auto& [id, layer] : found) {
        if (auto joined = layers_.join(id, layer); !joined) return tl::unexpected(joined.error());
        ids.push_back(id);
    }
    if (ids.empty()) return ids;
    const auto request = opens_.addJoined(ids, client::LoadSet::NoPayloads);
    if (auto opened = waitForOpen(request); !opened) return tl::unexpected(opened.error());
    std::erase_if(ids, [&](const LayerId& id) { return !layers_.find(id); });
    return ids;
}

Result<void> Client::Impl::close(const LayerId& id) {
    const auto* open = layers_.find(id);
    if (!open && !opens_.has(id) && !layers_.isAwaited(id))
        return fail(ErrorCode::LayerNotOpen, id.value + " is not open here");
    if (!mayBlock("close")) return {};
    // A layer without content has no edits to send.
    if (open && (open->isFilled() || open->isRefilling())) {
        flush(options_.connectTimeoutMs);
        // The layer keeps its content. If it was just reloaded, waits until the content is back.
        for (auto* live = layers_.find(id); live && live->isRefilling(); live = layers_.find(id)) {
            line_.connection().wait(milliseconds(1));
            tick(kBlockingBudgetMs);
        }
    }
    opens_.closed(id);
    layers_.close(id);
    return {};
}

// --- sending and saving

bool Client::Impl::flush(double timeoutMs) {
    if (!mayBlock("flush")) return false;
    const Stopwatch watch;
    layers_.adoptAllLoaded();  // edits before a layer was live are reported
    for (;;) {
        tick(kBlockingBudgetMs);
        if (!client::EditorFrame::hasWrites(layers_.live()) && session_.pendingTransactions() == 0)
            return true;
        if (watch.ms() > timeoutMs) return false;
        line_.connection().wait(milliseconds(5));
    }
}

Result<LayersSaved> Client::Impl::saveAndWait(std::vector<LayerId> layers, bool force,
                                              double timeoutMs) {
    const Stopwatch watch;
    if (!flush(timeoutMs)) return tl::unexpected(notConfirmed(timeoutMs));
    const double left = std::max(timeoutMs - watch.ms(), 0.0);
    const auto answer = answerTo(save(std::move(layers), force), left);
    if (!answer)
        return fail(ErrorCode::NotConnected,
                    "the server did not report in time that it has saved; it may still do so");
    return answer->map([](const client::Event& one) { return std::get<event::Saved>(one).answer; });
}

// Calls tick() until the server has answered. Returns nothing if it did not in time. Event handlers
// run meanwhile, and may make requests and wait themselves.
std::optional<Result<client::Event>> Client::Impl::answerTo(std::uint64_t request,
                                                            double timeoutMs) {
    answers_.await(request);
    const Stopwatch watch;
    do {
        tick(kBlockingBudgetMs);
        if (!answers_.isThere(request)) line_.connection().wait(milliseconds(5));
    } while (!answers_.isThere(request) && watch.ms() < timeoutMs);
    return answers_.take(request);
}

Error Client::Impl::notConfirmed(double timeoutMs) const {
    return {ErrorCode::NotConnected,
            std::to_string(session_.pendingTransactions()) +
                " transactions were not confirmed within " +
                std::to_string(std::int64_t(timeoutMs)) + " ms" +
                (session_.otherHistory()  ? ": " + session_.otherHistory()->reason.message
                 : session_.isConnected() ? std::string()
                                          : ": there is no connection to the server")};
}

// --- the past

bool Client::Impl::step() {
    const bool heard = line_.connection().wait(milliseconds(5));
    tick(kBlockingBudgetMs);
    return heard;
}

Result<std::shared_ptr<client::OpenPast>> Client::Impl::openPast(const LayerId& id,
                                                                 Revision revision) {
    const Revision at = revision > 0 ? revision : session_.revision();
    if (auto readable = history_.checkReadable(id, at); !readable)
        return tl::unexpected(readable.error());
    auto layers =
        client::PastLayers::create({session_, values_.cache(), filler_}, id,
                                   files_.isStarted() ? line_.connection().web() : std::nullopt);
    if (!layers) return tl::unexpected(layers.error());
    const auto past = std::make_shared<client::OpenPast>(std::move(*layers));
    std::erase_if(pasts_, [](const auto& one) { return one.expired(); });
    pasts_.push_back(past);
    if (auto moved = moveTo(past, at); !moved) return tl::unexpected(moved.error());
    return past;
}

Result<void> Client::Impl::moveTo(const std::shared_ptr<client::OpenPast>& past,
                                  Revision revision) {
    if (auto exists = history_.checkRevision(revision); !exists) return exists;
    past->layers()->aim(revision);
    return advanceUntilThere(past);
}

Result<void> Client::Impl::advanceUntilThere(const std::shared_ptr<client::OpenPast>& past) {
    Stopwatch silent;
    for (;;) {
        if (auto done = past->advance(); !done) return done;
        if (!past->isClosed() && !past->layers()->isThere()) tick(kBlockingBudgetMs);
        if (past->isClosed())
            return fail(ErrorCode::NotConnected, "the player was closed while it moved");
        if (past->layers()->isThere()) return {};
        if (line_.connection().wait(milliseconds(1))) silent = Stopwatch();
        if (silent.ms() > kSilenceMs)
            return fail(ErrorCode::NotConnected, "the server no longer answers");
    }
}

Result<std::string> Client::Impl::addressAt(const LayerId& id, Revision revision) {
    const auto web = line_.connection().web();
    if (!files_.isStarted() || !web)
        return fail(ErrorCode::InvalidConfiguration,
                    files_.problem()
                        ? files_.problem()->message
                        : "layers of the past are opened by addresses: connect with addresses");
    if (auto readable = history_.checkReadable(id, revision); !readable)
        return tl::unexpected(readable.error());
    const std::string prefix = web->project.empty() ? "" : web->project + "/";
    return "usdlive://" + web->hostAndPort() + "/" + client::encodedInAddress(prefix + id.value) +
           "@" + std::to_string(revision);
}

// --- disconnecting

std::optional<client::UnsentWork> Client::Impl::leave(double timeoutMs) {
    if (!mayBlock("leave")) return std::nullopt;
    tick(0, Seal::Now);
    session_.endGesture();
    gestures_ = 0;
    const bool sent = flush(timeoutMs);
    lost_.reportAll();
    events_.dispatch();
    if (sent) return std::nullopt;
    return unsent_.keep(session_);
}

}  // namespace usdlive
