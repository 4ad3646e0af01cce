// The work that a session sends: transactions, big values, its own previews and presence.
#include <algorithm>

#include "session/SessionImpl.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::client {

namespace {

// Small frames are joined into messages of about this size.
constexpr std::size_t kMessageBytes = 256 * 1024;
constexpr std::int64_t kReportGestureEveryMs = 400;

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

void Session::Impl::sendJson(std::string control) {
    host_.send(std::make_shared<const Bytes>(encodeFrame(ControlFrame{std::move(control)})));
}

void Session::Impl::sendAll() {
    moreToSend_ = false;
    if (online_) {
        requestBlobs(
            downloads_.due(nowMs_, [this](const Hash& hash) { return host_.needsBlob(hash); }));
        joinAgain();
    }
    if (!online_ || !isCaughtUp() || frozen_) return;
    sendTransactions();
    uploads_.dropUnwanted();
    uploads_.send(options_.uploadWindowChunks, nowMs_);
    if (const auto progress = uploads_.progress(nowMs_)) events_.push_back(*progress);
    sendPreview();
    sendPresence();
}

void Session::Impl::sendTransactions() {
    if (!sendParts()) return;
    if (held_ && (pending_.sent() > 0 || nowMs_ < held_->untilMs)) return;
    const auto ready = [this](const Pending& pending) { return uploads_.ready(pending.blobs); };
    Bytes message;
    const auto flush = [&] {
        if (!message.empty()) host_.send(std::make_shared<const Bytes>(std::move(message)));
        message = {};
    };
    std::vector<std::pair<std::uint64_t, Error>> tooLarge;
    std::size_t count = 0;
    for (Pending* pending : pending_.sendable(ready, !dirty_)) {
        if (held_ && pending_.sent() > 0) break;  // SE21: only one
        if (outOfTime(++count)) {
            moreToSend_ = true;
            break;
        }
        rebase(*pending);
        const Transaction& transaction = pending->transaction;
        const std::uint64_t whole =
            takesParts_ ? std::min(options_.wholeBytes, frameLimit()) : frameLimit();
        std::uint64_t size = leastFrameBytes(transaction.edits);
        Bytes frame;
        if (size <= std::min(whole, transactionLimit())) frame = compactFrames(transaction, whole);
        if (frame.empty() && size <= whole) {
            frame = encodeFrame(SubmitFrame{transaction});
            size = frame.size();
        }
        if (size > transactionLimit() || transaction.edits.size() > kMaxTransactionEdits) {
            tooLarge.emplace_back(transaction.id.sequence,
                                  largerThan(transactionLimit(), size, transaction.edits.size()));
            continue;
        }
        if (frame.empty() || size > whole) {
            flush();
            pending_.markSent(*pending, size);
            sending_ = Sending{transaction.id.sequence, {}};
            if (!sendParts()) break;
            continue;
        }
        if (message.size() + frame.size() > kMessageBytes) flush();
        message.insert(message.end(), frame.begin(), frame.end());
        pending_.markSent(*pending, frame.size());
    }
    flush();
    if (held_) held_->tried = pending_.sent() > 0;
    for (auto& [sequence, error] : tooLarge) lose(*pending_.take(sequence), std::move(error));
    if (dirty_) rebuild();
}

// FR9: returns the compact frame of the content, after the one that introduces its names. Returns
// nothing if the server does not know such frames, or the content is too large for one. The result
// has to be sent.
template <class Content>
Bytes Session::Impl::compactFrames(const Content& content, std::uint64_t mostBytes) {
    const auto frame = takesCompact_ ? encodeCompact(content, names_) : std::nullopt;
    if (!frame || frame->bytes->size() > mostBytes) return {};
    Bytes frames;
    if (const SharedBytes names = namesSent_.introduce(*frame)) frames = *names;
    appendBytes(frames, *frame->bytes);
    return frames;
}

std::uint64_t Session::Impl::frameLimit() const {
    return welcome_->maxFrameBytes > 0 ? welcome_->maxFrameBytes : kMaxFrameBytes;
}
std::uint64_t Session::Impl::transactionLimit() const {
    return takesParts_ ? welcome_->maxTransactionBytes.value_or(kMaxTransactionBytes)
                       : frameLimit();
}

// FR8. Returns false if more parts follow; no other transaction may be sent before them.
bool Session::Impl::sendParts() {
    while (sending_) {
        Pending* pending = pending_.find(sending_->sequence);
        if (!pending) {  // refused meanwhile
            sending_.reset();
            break;
        }
        if (host_.bulkBytes() == 0) return false;
        if (outOfTime() && sending_->at.part > 0) {
            moreToSend_ = true;
            return false;
        }
        const std::size_t bytes = std::min<std::uint64_t>(options_.partBytes, frameLimit() / 2);
        Bytes part = encodePart(pending->transaction, sending_->at, bytes);
        if (part.size() > frameLimit()) {
            const std::uint64_t sequence = std::exchange(sending_, std::nullopt)->sequence;
            lose(*pending_.take(sequence), valueLargerThan(frameLimit(), part.size()));
            rebuild();
            break;
        }
        if (sending_->at.isEnd) sending_.reset();
        host_.send(std::make_shared<const Bytes>(std::move(part)));
    }
    return true;
}

void Session::Impl::sendPreview() {
    if (!gesture_ || (!gesture_->outgoing && !preparePreview()) || !sendPreviewValues()) return;
    gesture_->shown = true;
    gesture_->named = std::move(gesture_->outgoing->named);
    host_.send(std::move(gesture_->outgoing->frame));
    gesture_->outgoing.reset();
}

// B3. While a preview is being sent, newer edits wait for the next one.
bool Session::Impl::preparePreview() {
    if (!gesture_->due(nowMs_)) return false;
    PreviewFrame preview = gesture_->preview();
    std::vector<Value> blobs;
    for (const Edit& edit : preview.edits) collectBlobs(edit.action, blobs);
    preview.author = {};  // the server knows it
    // One with big values waits for them, so its names would come too late for other frames.
    Bytes frame = blobs.empty() ? compactFrames(preview, Gesture::kMaxPreviewBytes) : Bytes();
    if (frame.empty()) frame = encodeFrame(preview);
    Gesture::Outgoing outgoing{std::make_shared<const Bytes>(std::move(frame)), {}, 0, {}};
    gesture_->bytes = outgoing.frame->size();
    gesture_->sentMs = nowMs_;
    gesture_->changed = false;
    if (gesture_->bytes > Gesture::kMaxPreviewBytes) return false;
    std::uint64_t named = 0;
    for (const Value& blob : blobs) {
        if (uploads_.isStored(blob.hash()) || !outgoing.named.insert(blob.hash()).second) continue;
        named += blob.size();
        if (gesture_->named.contains(blob.hash())) continue;
        SharedBytes bytes = host_.localBlob(blob.hash());
        if (!bytes) continue;  // the server has it
        gesture_->bytes += bytes->size();
        outgoing.values.push_back({blob.hash(), std::move(bytes)});
    }
    if (named > Gesture::kMaxPreviewValueBytes || (named > 0 && !takesPreviewValues_)) return false;
    gesture_->outgoing = std::move(outgoing);
    return true;
}

// Returns false if some remain.
bool Session::Impl::sendPreviewValues() {
    auto& [frame, values, offset, named] = *gesture_->outgoing;
    std::size_t chunks = options_.uploadWindowChunks;
    while (!values.empty()) {
        const std::size_t most = host_.bulkBytes();
        if (chunks-- == 0 || most == 0) return false;
        const auto& [hash, bytes] = values.front();
        BlobFrame part = blobPart(hash, *bytes, offset, most);
        part.gesture = gesture_->pending.transaction.gesture;
        host_.send(std::make_shared<const Bytes>(encodeFrame(part)));
        offset += part.rawBytes;
        if (offset < bytes->size()) continue;
        values.pop_front();
        offset = 0;
    }
    return true;
}

// Reports an open gesture to the host from time to time, so that the journal keeps it.
void Session::Impl::reportGesture() {
    if (!gesture_ || !gesture_->unreported || nowMs_ - gestureReportedMs_ < kReportGestureEveryMs)
        return;
    gestureReportedMs_ = nowMs_;
    gesture_->unreported = false;
    reportPending(gesture_->pending);
}

void Session::Impl::withdrawPreview(std::uint64_t gesture) {
    if (gesture == 0 || !online_) return;
    host_.send(std::make_shared<const Bytes>(
        encodeFrame(PreviewFrame{options_.client, gesture, revision_, {}})));
}

}  // namespace usdlive::client
