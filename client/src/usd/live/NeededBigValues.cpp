// Requests, delivers and releases the big values of one client.
#include "usd/live/NeededBigValues.h"

#include <algorithm>
#include <utility>

namespace usdlive::client {

namespace {

constexpr std::size_t kMaxCacheMemory = std::size_t(256) << 20;
// Values are released if more than this number are kept, and twice as many as after the last
// release.
constexpr std::size_t kKeptAtLeast = 8;

}  // namespace

NeededBigValues::NeededBigValues(std::filesystem::path folder, std::uint64_t folderBytes)
    : cache_(std::move(folder), kMaxCacheMemory, folderBytes) {}

SharedBytes NeededBigValues::Source::blob(const Hash& hash) {
    auto bytes = values_.cache_.blob(hash);
    if (!bytes) values_.missing_.insert(hash);
    return bytes;
}

void NeededBigValues::arrived(const Hash& hash, SharedBytes bytes, bool lasting) {
    if (lasting)
        cache_.cacheBlob(hash, std::move(bytes));
    else
        cache_.holdBlob(hash, std::move(bytes));
    arrived_.push_back(hash);
}

void NeededBigValues::committed(const Commit& commit) {
    for (const Edit& edit : commit.edits)
        forEachBlob(edit.action, [&](const Value& blob) { committed_.insert(blob.hash()); });
}

void NeededBigValues::deliver(const LiveSet& layers) {
    for (const auto& hash : std::exchange(arrived_, {})) {
        awaited_.erase(hash);
        for (const auto& [id, live] : layers.all()) live->blobArrived(hash);
    }
}

void NeededBigValues::requestMissing(Session& session) {
    for (const auto& hash : std::exchange(missing_, {}))
        if (awaited_.insert(hash).second) session.requestBlob(hash);
}

bool NeededBigValues::isAwaitedBy(const LiveLayer& layer) const {
    return std::ranges::any_of(awaited_, [&](const Hash& hash) { return layer.waitsFor(hash); });
}

bool NeededBigValues::isWorthReleasing(const Session& session, const std::set<Hash>& lost) {
    const bool idle = session.pendingTransactions() == 0 && !session.inGesture();
    return cache_.kept() > (idle ? lost.size() : std::max(kKeptAtLeast, 2 * stillKept_));
}

void NeededBigValues::keepOnly(const std::set<Hash>& named) {
    cache_.keepOnly(named, committed_);
    committed_.clear();
    stillKept_ = cache_.kept();
}

}  // namespace usdlive::client
