// Reads the history and collects the big values that it names.
#include "project/NamedBlobs.h"

#include <algorithm>

#include "usdlive/common/protocol/CommitBlobs.h"

namespace usdlive::server {

Result<bool> NamedBlobs::read(const CommitStore& store, std::size_t mostBytes) {
    if (!isSameHistory(store)) *this = {};
    const CommitStore::Base base = store.base();
    auto done = base == base_ ? Result<void>() : begin(store, base);
    if (done) done = layers_.empty() ? readCommits(store, mostBytes) : readLayer(store);
    // The base has moved during the read.
    if (!done && done.error().code == ErrorCode::HistoryReplaced) return false;
    if (!done) return tl::unexpected(done.error());
    return layers_.empty() && base_ == store.base() && upTo_ == store.head().revision;
}

/// Forgets values that only replaced commits named, and starts to read the layers at the base.
Result<void> NamedBlobs::begin(const CommitStore& store, const CommitStore::Base& base) {
    auto layers = store.layers();
    if (!layers) return tl::unexpected(layers.error());
    base_ = base;
    layers_ = std::move(*layers);
    std::erase_if(last_, [&](const auto& one) { return one.second <= base.revision; });
    if (upTo_ >= base.revision) return {};
    upTo_ = base.revision;
    hash_ = base.hash;
    return {};
}

Result<void> NamedBlobs::readLayer(const CommitStore& store) {
    const auto doc = store.layerAt(layers_.back(), base_.revision);
    if (!doc) return tl::unexpected(doc.error());
    layers_.pop_back();
    if (!*doc) return {};
    forEachBlob(**doc, [&](const Value& blob) {
        Revision& last = last_[blob.hash()];
        last = std::max(last, base_.revision);
    });
    return {};
}

/// Returns false if the store has failed, was opened again, and has lost commits that were read.
bool NamedBlobs::isSameHistory(const CommitStore& store) const {
    if (upTo_ < store.base().revision) return true;  // it can only follow
    const auto hash = store.hashAt(upTo_);
    return hash && *hash == hash_;
}

Result<void> NamedBlobs::look(const StoredCommit& commit) {
    const auto frames = splitMessage(*commit.frame, ~std::uint32_t(0));
    if (!frames) return tl::unexpected(frames.error());
    for (const ByteView frame : *frames) {
        const auto looked =
            forEachBlob(frame, [&](const Hash& hash) { last_[hash] = commit.revision; });
        if (!looked) return looked;
    }
    return {};
}

Result<void> NamedBlobs::readCommits(const CommitStore& store, std::size_t mostBytes) {
    std::size_t bytes = 0;
    Result<void> looked;
    const auto read = store.read(upTo_ + 1, ~Revision(0), [&](const StoredCommit& commit) {
        looked = look(commit);
        if (!looked) return false;
        upTo_ = commit.revision;
        hash_ = commit.hash;
        bytes += commit.frame->size();
        return bytes < mostBytes;
    });
    return read.and_then([&] { return looked; });
}

}  // namespace usdlive::server
