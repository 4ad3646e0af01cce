// Moves layers of the past for an editor.
#include "usdlive/client/usd/HistoryPlayer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "basics/Clocks.h"
#include "usd/editor/ClientImpl.h"
#include "usd/editor/OpenPast.h"

namespace usdlive {

namespace {

constexpr double kLongestShownPauseMs = 1'000;
// The most commits that one frame passes: about 10 ms for edits of single values.
constexpr int kMostPerFrame = 128;

Error playerClosed() {
    return {ErrorCode::NotConnected,
            "this player was closed, or its connection was. Make another one"};
}

}  // namespace

struct HistoryPlayer::State {
    Client::Impl& impl;  // exists as long as `past` is not closed
    std::shared_ptr<client::OpenPast> past;
    Revision target = 0;
    double speed = 0;
    double creditMs = 0;  // is left of the history's time
    std::int64_t tickedAtMs = 0;

    [[nodiscard]] client::PastLayers* layers() const {
        return past->isClosed() ? nullptr : past->layers();
    }
    /// Returns why a function must not be called now.
    [[nodiscard]] std::optional<Error> whyNot(const char* function, bool blocks) const {
        if (!layers()) return playerClosed();
        if (auto error = impl.misuse(function, blocks)) return error;
        if (past->isAdvancing())
            return Error{ErrorCode::InvalidArgument,
                         std::string(function) +
                             "() was called by a notice handler while the layers of the player "
                             "change. Call it after that"};
        return std::nullopt;
    }
    /// Returns the time between a commit and the one before it, in the history's milliseconds.
    [[nodiscard]] double pauseBefore(Revision revision) const {
        const auto at = layers()->timeOf(revision), before = layers()->timeOf(revision - 1);
        if (!at || !before) return 0;
        return std::min(double(*at - *before), kLongestShownPauseMs* std::abs(speed));
    }
    /// Aims at what is shown.
    void stay() {
        target = layers()->shown();
        layers()->aim(target);
    }
    // Sets the target for a frame.
    void goOn(double elapsedMs) {
        client::PastLayers& past = *layers();
        // The content at which the last frame has aimed is still awaited.
        if (past.shown() != target) return;
        const bool forward = speed > 0;
        const Revision end = forward ? past.last() : past.first();
        if (target == end) {
            speed = 0;
            return;
        }
        creditMs += std::min(elapsedMs, kLongestShownPauseMs) * std::abs(speed);
        past.prefetch(forward ? client::PastLayers::Direction::Forward
                              : client::PastLayers::Direction::Backward);
        for (int count = 0; count < kMostPerFrame && target != end; ++count) {
            const Revision next = forward ? target + 1 : target - 1;
            const double pause = past.knows(next) ? pauseBefore(forward ? next : target) : 0;
            if (!past.knows(next) && count > 0) break;
            if (creditMs < pause) break;
            creditMs -= pause;
            target = next;
        }
        past.aim(target);
    }
};

HistoryPlayer::HistoryPlayer(std::unique_ptr<State> state) : state_(std::move(state)) {}

HistoryPlayer::~HistoryPlayer() { close(); }

pxr::SdfLayerRefPtr HistoryPlayer::layer() const {
    const auto* layers = state_->layers();
    return layers ? layers->root() : pxr::SdfLayerRefPtr();
}
Revision HistoryPlayer::revision() const {
    return state_->layers() ? state_->layers()->shown() : 0;
}
Revision HistoryPlayer::first() const { return state_->layers() ? state_->layers()->first() : 0; }
Revision HistoryPlayer::last() const { return state_->layers() ? state_->layers()->last() : 0; }

Result<void> HistoryPlayer::seek(Revision revision) {
    if (auto error = state_->whyNot("seek", true)) return tl::unexpected(*error);
    state_->creditMs = 0;
    const auto past = state_->past;
    state_->target = revision;
    auto moved = state_->impl.moveTo(past, revision);
    // A handler may have moved or closed it meanwhile.
    if (!moved && !past->isClosed() && state_->target == revision) {
        state_->stay();
    }
    return moved;
}

void HistoryPlayer::play(double speed) {
    if (!state_->layers()) return;
    state_->impl.require("play");
    state_->speed = std::isfinite(speed) ? speed : 0;
    state_->creditMs = 0;
    state_->tickedAtMs = steadyMs();
}

bool HistoryPlayer::isPlaying() const { return state_->layers() && state_->speed != 0; }

Result<bool> HistoryPlayer::tick() {
    if (auto error = state_->whyNot("tick", true)) return tl::unexpected(*error);
    const std::int64_t now = steadyMs();
    const double elapsedMs = double(now - std::exchange(state_->tickedAtMs, now));
    const auto past = state_->past;
    const Revision before = past->layers()->shown();
    if (state_->speed != 0) state_->goOn(elapsedMs);
    const auto done = past->advance();
    if (past->isClosed()) return true;
    if (!done) {
        state_->stay();
        // Goes on when there is a connection again.
        if (done.error().code == ErrorCode::NotConnected && state_->speed != 0) return false;
        state_->speed = 0;
        return tl::unexpected(done.error());
    }
    return past->layers()->shown() != before;
}

void HistoryPlayer::close() {
    if (state_) state_->past->close();
}
bool HistoryPlayer::isClosed() const { return state_->past->isClosed(); }

// --- the client's side

Result<std::unique_ptr<HistoryPlayer>> Client::openPlayer(const LayerId& layer, Revision revision) {
    if (auto error = misuse("openPlayer", true)) return tl::unexpected(*error);
    auto past = impl_->openPast(layer, revision);
    if (!past) return tl::unexpected(past.error());
    auto state = std::make_unique<HistoryPlayer::State>(*impl_, *past);
    state->target = (*past)->layers()->shown();
    return std::unique_ptr<HistoryPlayer>(new HistoryPlayer(std::move(state)));
}

}  // namespace usdlive
