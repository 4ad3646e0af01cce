// The big values that are known to be stored.
#pragma once

#include <cstddef>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "usdlive/common/core/Hash.h"

namespace usdlive::server {

/// The big values that are known to be stored, from the answers of the store.
class KnownBlobs {
public:
    [[nodiscard]] bool has(const Hash& hash) const { return stored_.contains(hash); }
    void stored(const Hash& hash) {
        if (stored_.size() >= kMost && asked_.empty()) stored_.clear();  // the store is asked again
        stored_.insert(hash);
    }
    void dropped(const std::vector<Hash>& hashes) {
        for (const Hash& hash : hashes) stored_.erase(hash);
    }

    /// Returns whether the store is being asked for the value.
    [[nodiscard]] bool isAsked(const Hash& hash) const { return asked_.contains(hash); }
    void ask(const std::vector<Hash>& hashes) {
        for (const Hash& hash : hashes) ++asked_[hash];
    }
    void answered(const std::vector<Hash>& hashes) {
        for (const Hash& hash : hashes) end(asked_, hash);
    }
    /// Call it when a part of the value is passed to the store.
    void write(const Hash& hash) { ++writing_[hash]; }
    void written(const Hash& hash) { end(writing_, hash); }
    /// Returns whether the value may be dropped. It must stay while an answer of the store about it
    /// is pending, because the answer would be wrong afterwards.
    [[nodiscard]] bool mayDrop(const Hash& hash) const {
        return !asked_.contains(hash) && !writing_.contains(hash);
    }

private:
    using Counts = std::unordered_map<Hash, std::size_t>;
    static void end(Counts& counts, const Hash& hash) {
        const auto entry = counts.find(hash);
        if (entry != counts.end() && --entry->second == 0) counts.erase(entry);
    }

    static constexpr std::size_t kMost = 200'000;
    std::unordered_set<Hash> stored_;
    Counts asked_, writing_;
};

}  // namespace usdlive::server
