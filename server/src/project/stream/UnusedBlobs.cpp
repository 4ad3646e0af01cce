// Decides when unused big values may be removed from the store.
#include "project/stream/UnusedBlobs.h"

#include <algorithm>

namespace usdlive::server {

void UnusedBlobs::named(const std::vector<Hash>& blobs, Revision revision) {
    for (const Hash& hash : blobs) {
        named_[hash] = revision;
        unused_.erase(hash);
    }
}

// An earlier durable commit may also name the value.
void UnusedBlobs::rolledBack(Revision durable) {
    for (auto& [hash, revision] : named_) revision = std::min(revision, durable);
}

void UnusedBlobs::stored(const Hash& hash, SessionId session) {
    unused_[hash] = {std::nullopt, session};
}

std::vector<Hash> UnusedBlobs::take(const Round& round) {
    if (round.upTo < upTo_) return {};
    upTo_ = round.upTo;
    std::erase_if(named_, [&](const auto& one) { return one.second <= round.upTo; });
    std::unordered_map<Hash, Unused> unused;
    std::vector<Hash> taken;
    for (const Hash& hash : round.unnamed) {
        if (named_.contains(hash) || round.isNamed(hash)) continue;
        const auto known = unused_.find(hash);
        Unused one = known == unused_.end() ? Unused() : known->second;
        if (!one.sinceMs || round.uploads(one.session)) one.sinceMs = round.nowMs;
        if (round.nowMs - *one.sinceMs >= round.keepMs)
            taken.push_back(hash);
        else
            unused.emplace(hash, one);
    }
    // Values that were stored during this round belong to the next one.
    for (const auto& [hash, one] : unused_)
        if (!one.sinceMs && one.session != 0)
            unused.try_emplace(hash, Unused{round.nowMs, one.session});
    for (const Hash& hash : taken) unused.erase(hash);
    unused_ = std::move(unused);
    return taken;
}

}  // namespace usdlive::server
