// Sends previews of the own gesture.
#include "session/OwnPreviews.h"

namespace usdlive::client {

void OwnPreviews::send(Gesture& gesture, std::int64_t nowMs) {
    if ((!gesture.outgoing && !prepare(gesture, nowMs)) || !sendValues(gesture)) return;
    gesture.shown = true;
    gesture.named = std::move(gesture.outgoing->named);
    channel_.send(std::move(gesture.outgoing->frame));
    gesture.outgoing.reset();
}

// While a preview is being sent, newer edits wait for the next one.
bool OwnPreviews::prepare(Gesture& gesture, std::int64_t nowMs) {
    if (!gesture.due(nowMs)) return false;
    PreviewFrame preview = gesture.preview();
    std::vector<Value> blobs;
    for (const Edit& edit : preview.edits) collectBlobs(edit.action, blobs);
    preview.author = {};  // the server knows it
    // One with big values waits for them, so its names would come too late for other frames.
    Bytes frame =
        blobs.empty() ? channel_.compactFrames(preview, Gesture::kMaxPreviewBytes) : Bytes();
    if (frame.empty()) frame = encodeFrame(preview);
    Gesture::Outgoing outgoing{std::make_shared<const Bytes>(std::move(frame)), {}, 0, {}};
    gesture.bytes = outgoing.frame->size();
    gesture.sentMs = nowMs;
    gesture.changed = false;
    if (gesture.bytes > Gesture::kMaxPreviewBytes) return false;
    std::uint64_t named = 0;
    for (const Value& blob : blobs) {
        if (uploads_.isStored(blob.hash()) || !outgoing.named.insert(blob.hash()).second) continue;
        named += blob.size();
        if (gesture.named.contains(blob.hash())) continue;
        SharedBytes bytes = host_.localBlob(blob.hash());
        if (!bytes) continue;  // the server has it
        gesture.bytes += bytes->size();
        outgoing.values.push_back({blob.hash(), std::move(bytes)});
    }
    if (named > Gesture::kMaxPreviewValueBytes || (named > 0 && !channel_.takesPreviewValues()))
        return false;
    gesture.outgoing = std::move(outgoing);
    return true;
}

// Returns false if some remain.
bool OwnPreviews::sendValues(Gesture& gesture) {
    auto& [frame, values, offset, named] = *gesture.outgoing;
    std::size_t chunks = options_.uploadWindowChunks;
    while (!values.empty()) {
        const std::size_t most = host_.bulkBytes();
        if (chunks-- == 0 || most == 0) return false;
        const auto& [hash, bytes] = values.front();
        BlobFrame part = blobPart(hash, *bytes, offset, most);
        part.gesture = gesture.pending.transaction.gesture;
        channel_.send(encodeFrame(part));
        offset += part.rawBytes;
        if (offset < bytes->size()) continue;
        values.pop_front();
        offset = 0;
    }
    return true;
}

void OwnPreviews::withdraw(std::uint64_t gesture, Revision revision) {
    if (gesture == 0 || !channel_.isOnline()) return;
    channel_.send(encodeFrame(PreviewFrame{options_.client, gesture, revision, {}}));
}

}  // namespace usdlive::client
