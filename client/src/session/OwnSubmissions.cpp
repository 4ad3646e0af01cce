// Sends own transactions.
#include "session/OwnSubmissions.h"

#include <algorithm>

namespace usdlive::client {

namespace {

// Small frames are joined into messages of about this size.
constexpr std::size_t kMessageBytes = 256 * 1024;
// Pauses before transactions are sent again that were refused for a reason that passes.
constexpr std::int64_t kFirstPauseMs = 500, kLongestPauseMs = 4'000;

std::string mib(std::uint64_t bytes) { return std::to_string((bytes + 1048575) >> 20) + " MiB"; }

Error largerThan(std::uint64_t most, std::uint64_t size, std::size_t edits) {
    return {ErrorCode::TransactionTooLarge,
            "what was written in one frame has " + std::to_string(edits) + " edits and " +
                mib(size) + ", and the server takes " + std::to_string(kMaxTransactionEdits) +
                " edits and " + mib(most) +
                " at once: write it in several frames, with tick() between them, or serve with a "
                "larger --max-transaction-mib"};
}

Error valueLargerThan(std::uint64_t most, std::uint64_t size) {
    return {ErrorCode::TransactionTooLarge,
            "a single value that was written has " + mib(size) + ", and the server takes " +
                mib(most) + ": write it part by part, or serve with a larger --max-frame-mib"};
}

}  // namespace

std::vector<OwnSubmissions::TooLarge> OwnSubmissions::send(std::int64_t nowMs, bool known) {
    hasMore_ = false;
    std::vector<TooLarge> tooLarge;
    if (!sendParts(tooLarge)) return tooLarge;
    if (held_ && (pending_.sent() > 0 || nowMs < held_->untilMs)) return tooLarge;
    sendWhole(known, tooLarge);
    if (held_) held_->tried = pending_.sent() > 0;
    return tooLarge;
}

void OwnSubmissions::sendWhole(bool known, std::vector<TooLarge>& tooLarge) {
    const std::uint64_t limit = channel_.transactionLimit();
    const std::uint64_t whole = std::min(options_.wholeBytes, channel_.frameLimit());
    const auto ready = [this](const Pending& pending) { return uploads_.ready(pending.blobs); };
    Bytes message;
    const auto flush = [&] {
        if (!message.empty()) channel_.send(std::exchange(message, {}));
    };
    std::size_t count = 0;
    for (Pending* pending : pending_.sendable(ready, known)) {
        if (held_ && pending_.sent() > 0) break;  // SE21: only one
        if (deadline_.isOver(++count)) {
            hasMore_ = true;
            break;
        }
        addresses_.rebase(*pending);
        const Transaction& transaction = pending->transaction;
        std::uint64_t size = leastFrameBytes(transaction.edits);
        Bytes frame;
        if (size <= std::min(whole, limit)) frame = channel_.compactFrames(transaction, whole);
        if (frame.empty() && size <= whole) {
            frame = encodeFrame(SubmitFrame{transaction});
            size = frame.size();
        }
        if (size > limit || transaction.edits.size() > kMaxTransactionEdits) {
            tooLarge.emplace_back(transaction.id.sequence,
                                  largerThan(limit, size, transaction.edits.size()));
            continue;
        }
        if (frame.empty() || size > whole) {
            flush();
            pending_.markSent(*pending, size);
            partial_ = Partial{transaction.id.sequence, {}};
            if (!sendParts(tooLarge)) break;
            continue;
        }
        if (message.size() + frame.size() > kMessageBytes) flush();
        message.insert(message.end(), frame.begin(), frame.end());
        pending_.markSent(*pending, frame.size());
    }
    flush();
}

// FR8. Returns false if more parts follow; no other transaction may be sent before them.
bool OwnSubmissions::sendParts(std::vector<TooLarge>& tooLarge) {
    while (partial_) {
        const Pending* pending = pending_.find(partial_->sequence);
        if (!pending) {  // refused meanwhile
            partial_.reset();
            break;
        }
        if (host_.bulkBytes() == 0) return false;
        if (deadline_.isOver() && partial_->at.part > 0) {
            hasMore_ = true;
            return false;
        }
        const std::uint64_t limit = channel_.frameLimit();
        const std::size_t bytes = std::min<std::uint64_t>(options_.partBytes, limit / 2);
        Bytes part = encodePart(pending->transaction, partial_->at, bytes);
        if (part.size() > limit) {
            tooLarge.emplace_back(partial_->sequence, valueLargerThan(limit, part.size()));
            partial_.reset();
            break;
        }
        if (partial_->at.isEnd) partial_.reset();
        channel_.send(std::move(part));
    }
    return true;
}

// The server also refuses all later transactions until one of the refused ones is sent again, so
// that their order is kept.
void OwnSubmissions::hold(std::uint64_t sequence, const Error& reason, std::int64_t nowMs) {
    Pending* pending = pending_.find(sequence);
    if (!pending) return;
    pending_.markUnsent(*pending);
    pending->everSent = false;  // the server does not have it
    if (!held_)
        events_.report({reason.code, reason.message +
                                         ". What you wrote is kept, and is sent again when this "
                                         "has passed"});
    else if (!held_->tried)
        return;  // it was sent before the first refusal arrived
    const std::int64_t pause =
        held_ ? std::min(2 * held_->pauseMs, kLongestPauseMs) : kFirstPauseMs;
    held_ = Held{pause, nowMs + pause};
}

void OwnSubmissions::restart() {
    if (!partial_) return;
    if (Pending* pending = pending_.find(partial_->sequence)) pending_.markUnsent(*pending);
    partial_.reset();
}

void OwnSubmissions::disconnected() {
    pending_.markAllUnsent();
    partial_.reset();
    held_.reset();
}

}  // namespace usdlive::client
