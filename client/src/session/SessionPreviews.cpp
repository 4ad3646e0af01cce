// Previews of others, and the big values that they and the layers name.
#include "session/SessionImpl.h"

namespace usdlive::client {

void Session::Impl::handle(PreviewFrame&& frame) {
    if (frame.author == options_.client) return;
    const std::pair id{frame.author, frame.gesture};
    const bool withdrawn = frame.edits.empty();
    if (withdrawn) {
        if (previews_.erase(id) == 0) return;
    } else {
        const auto entry = previews_.try_emplace(id).first;
        Preview& preview = entry->second;
        if (preview.slot == 0) preview.slot = ++lastSlot_;
        if (preview.waiting)
            preview.newest = std::move(frame);
        else
            present(*entry, std::move(frame));
        return;
    }
    previewsChanged();
    events_.push_back(event::PreviewChanged{id.first, id.second, withdrawn});
}

// Shows a preview, or waits for its big values first.
void Session::Impl::present(Previews::value_type& entry, PreviewFrame frame) {
    auto& [id, preview] = entry;
    preview.missing = missingOf(frame);
    if (preview.missing.empty()) {
        preview.waiting.reset();
        preview.frame = std::move(frame);
        previewsChanged();
        events_.push_back(event::PreviewChanged{id.first, id.second, false});
        return;
    }
    preview.waiting = std::move(frame);
    std::vector<Hash> toAsk;
    for (const Hash& hash : preview.missing)
        if (downloads_.want(hash, false, online_)) toAsk.push_back(hash);
    requestBlobs(toAsk);
}

// Ends the wait for a preview, and continues with the newest one. Those in between are skipped.
void Session::Impl::presentNewest(Previews::value_type& entry) {
    Preview& preview = entry.second;
    preview.waiting.reset();
    preview.missing.clear();
    if (auto newest = std::exchange(preview.newest, std::nullopt))
        present(entry, std::move(*newest));
}

// Called when other layers are joined: previews may name big values in them.
void Session::Impl::presentAgain() {
    for (auto& entry : previews_) {
        Preview& preview = entry.second;
        previewsChanged();
        auto frame = std::exchange(preview.frame, std::nullopt);
        for (auto* later : {&preview.waiting, &preview.newest})
            if (*later) frame = std::exchange(*later, std::nullopt);
        if (frame) present(entry, std::move(*frame));
    }
}

std::set<Hash> Session::Impl::missingOf(const PreviewFrame& frame) {
    std::vector<Value> blobs;
    for (const Edit& edit : frame.edits)
        if (confirmed_.contains(edit.layer)) collectBlobs(edit.action, blobs);
    std::set<Hash> missing;
    for (const Value& blob : blobs)
        if (!missing.contains(blob.hash()) && !host_.holdsBlob(blob.hash()))
            missing.insert(blob.hash());
    return missing;
}

void Session::Impl::handle(ReceivedBlob&& blob) {
    if (!blob.whole)
        blobFailed(blob.hash, blob.whole.error());
    else if (*blob.whole)
        blobReceived(blob.hash, std::move(*blob.whole));
    else
        downloads_.progressed(blob.hash, blob.bytes);
}

void Session::Impl::blobReceived(const Hash& hash, SharedBytes bytes) {
    const auto done = downloads_.arrived(hash);
    if (done.outcome != BlobDownloads::Outcome::Arrived) return;
    host_.blobArrived(hash, std::move(bytes), done.lasting);
    for (auto& entry : previews_) {
        auto& [id, preview] = entry;
        if (preview.missing.erase(hash) == 0 || !preview.missing.empty()) continue;
        preview.frame = std::move(preview.waiting);
        previewsChanged();
        events_.push_back(event::PreviewChanged{id.first, id.second, false});
        presentNewest(entry);
    }
}

void Session::Impl::blobFailed(const Hash& hash, Error error) {
    const auto done = downloads_.failed(hash, nowMs_);
    if (done.lasting && done.first) report(std::move(error), about(hash));
    if (done.outcome != BlobDownloads::Outcome::NotWanted)
        for (auto& entry : previews_)
            if (entry.second.missing.contains(hash)) presentNewest(entry);
}

void Session::Impl::requestBlobs(const std::vector<Hash>& hashes) {
    for (const Hash& hash : hashes) sendControl(RequestBlob{hash, downloads_.here(hash)});
}

void Session::Impl::on(const BlobStored& message) {
    uploads_.stored(message.hash);
    host_.blobStored(message.hash);
}

}  // namespace usdlive::client
