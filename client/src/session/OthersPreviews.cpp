// Shows previews of others when their big values are here.
#include "session/OthersPreviews.h"

namespace usdlive::client {

void OthersPreviews::received(PreviewFrame&& frame) {
    if (frame.author == self_) return;
    const std::pair id{frame.author, frame.gesture};
    if (frame.edits.empty()) return committed(id.first, id.second);  // it was withdrawn
    const auto entry = previews_.try_emplace(id).first;
    Preview& preview = entry->second;
    if (preview.slot == 0) preview.slot = ++lastSlot_;
    if (preview.waiting)
        preview.newest = std::move(frame);
    else
        present(*entry, std::move(frame));
}

void OthersPreviews::committed(const ClientId& author, std::uint64_t gesture) {
    if (previews_.erase({author, gesture}) == 0) return;
    changed_();
    events_.push(event::PreviewChanged{author, gesture, true});
}

void OthersPreviews::endAll() {
    if (!previews_.empty()) changed_();
    for (const auto& [id, preview] : std::exchange(previews_, {}))
        events_.push(event::PreviewChanged{id.first, id.second, true});
}

// Shows a preview, or waits for its big values first.
void OthersPreviews::present(Previews::value_type& entry, PreviewFrame frame) {
    Preview& preview = entry.second;
    preview.missing = missingOf(frame);
    if (preview.missing.empty()) {
        preview.waiting.reset();
        return show(entry, std::move(frame));
    }
    preview.waiting = std::move(frame);
    for (const Hash& hash : preview.missing) downloads_.want(hash, false);
}

void OthersPreviews::show(Previews::value_type& entry, PreviewFrame frame) {
    auto& [id, preview] = entry;
    preview.frame = std::move(frame);
    changed_();
    events_.push(event::PreviewChanged{id.first, id.second, false});
}

// Ends the wait for a preview, and continues with the newest one. Those in between are skipped.
void OthersPreviews::presentNewest(Previews::value_type& entry) {
    Preview& preview = entry.second;
    preview.waiting.reset();
    preview.missing.clear();
    if (auto newest = std::exchange(preview.newest, std::nullopt))
        present(entry, std::move(*newest));
}

void OthersPreviews::presentAgain() {
    for (auto& entry : previews_) {
        Preview& preview = entry.second;
        changed_();
        auto frame = std::exchange(preview.frame, std::nullopt);
        for (auto* later : {&preview.waiting, &preview.newest})
            if (*later) frame = std::exchange(*later, std::nullopt);
        if (frame) present(entry, std::move(*frame));
    }
}

std::set<Hash> OthersPreviews::missingOf(const PreviewFrame& frame) const {
    std::vector<Value> blobs;
    for (const Edit& edit : frame.edits)
        if (confirmed_.contains(edit.layer)) collectBlobs(edit.action, blobs);
    std::set<Hash> missing;
    for (const Value& blob : blobs)
        if (!missing.contains(blob.hash()) && !host_.holdsBlob(blob.hash()))
            missing.insert(blob.hash());
    return missing;
}

void OthersPreviews::blobArrived(const Hash& hash) {
    for (auto& entry : previews_) {
        Preview& preview = entry.second;
        if (preview.missing.erase(hash) == 0 || !preview.missing.empty()) continue;
        show(entry, *std::exchange(preview.waiting, std::nullopt));
        presentNewest(entry);
    }
}

void OthersPreviews::blobFailed(const Hash& hash) {
    for (auto& entry : previews_)
        if (entry.second.missing.contains(hash)) presentNewest(entry);
}

std::map<std::uint64_t, const PreviewFrame*> OthersPreviews::shown() const {
    std::map<std::uint64_t, const PreviewFrame*> inOrder;
    for (const auto& [id, preview] : previews_)
        if (preview.frame) inOrder[preview.slot] = &*preview.frame;
    return inOrder;
}

}  // namespace usdlive::client
