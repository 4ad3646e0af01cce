// The work that a session sends: transactions, big values, previews and presence.
#include "session/SessionImpl.h"

namespace usdlive::client {

namespace {

constexpr std::int64_t kReportGestureEveryMs = 400;

}  // namespace

void Session::Impl::sendAll() {
    if (channel_.isOnline()) {
        downloads_.requestDue(nowMs_, [this](const Hash& hash) { return host_.needsBlob(hash); });
        opened_.askAgain(nowMs_);
    }
    if (!maySend()) return;
    sendTransactions();
    uploads_.dropUnwanted();
    uploads_.send(options_.uploadWindowChunks, nowMs_);
    if (const auto progress = uploads_.progress(nowMs_)) events_.push(*progress);
    if (gesture_) ownPreviews_.send(*gesture_, nowMs_);
    people_.send(nowMs_);
}

void Session::Impl::sendTransactions() {
    auto tooLarge = submissions_.send(nowMs_, !dirty_);
    for (auto& [sequence, error] : tooLarge) lose(*pending_.take(sequence), std::move(error));
    if (!tooLarge.empty()) rebuild();
}

// Reports an open gesture to the host from time to time, so that the journal keeps it.
void Session::Impl::reportGesture() {
    if (!gesture_ || !gesture_->unreported || nowMs_ - gestureReportedMs_ < kReportGestureEveryMs)
        return;
    gestureReportedMs_ = nowMs_;
    gesture_->unreported = false;
    reportPending(gesture_->pending);
}

}  // namespace usdlive::client
