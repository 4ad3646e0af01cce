// Which big values are stored.
#pragma once

#include <cstddef>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "usdlive/common/core/Hash.h"

namespace usdlive::server {

/// Knows which big values are stored, as far as the store was asked.
class KnownBlobs {
public:
    [[nodiscard]] bool has(const Hash& hash) const { return stored_.contains(hash); }
    void stored(const Hash& hash) {
        if (stored_.size() >= kMost && asked_.empty()) stored_.clear();  // asked for again
        stored_.insert(hash);
    }
    void dropped(const std::vector<Hash>& hashes) {
        for (const Hash& hash : hashes) stored_.erase(hash);
    }

    /// The store is being asked for it.
    [[nodiscard]] bool isAsked(const Hash& hash) const { return asked_.contains(hash); }
    void ask(const std::vector<Hash>& hashes) {
        for (const Hash& hash : hashes) ++asked_[hash];
    }
    void answered(const std::vector<Hash>& hashes) {
        for (const Hash& hash : hashes) end(asked_, hash);
    }
    /// The store is given a part of it.
    void write(const Hash& hash) { ++writing_[hash]; }
    void written(const Hash& hash) { end(writing_, hash); }
    /// Whatever the store answers holds only if it is not dropped meanwhile.
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
