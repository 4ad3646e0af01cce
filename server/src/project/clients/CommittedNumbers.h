// The committed transactions of a client (M9).
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "project/CommitStore.h"

namespace usdlive::server {

/// The committed transactions of one client, with the same content as the store's record (M9).
/// Starts with that record and is updated with each commit.
class CommittedNumbers {
public:
    using Entry = std::pair<std::uint64_t, Revision>;

    explicit CommittedNumbers(const ClientRecord& record)
        : wasUnknown_(record.committed.empty()), forgottenUpTo_(record.forgottenUpTo) {
        for (const Entry& one : record.committed)
            if (one.first + kKept <= record.committed.back().first)
                late_.insert(one);
            else
                last_.push_back(one);
    }

    [[nodiscard]] std::optional<Revision> find(std::uint64_t sequence) const {
        const auto found = std::ranges::lower_bound(last_, sequence, {}, &Entry::first);
        if (found != last_.end() && found->first == sequence) return found->second;
        const auto late = late_.find(sequence);
        return late == late_.end() ? std::nullopt : std::optional(late->second);
    }
    void add(std::uint64_t sequence, Revision revision) {
        if (!last_.empty() && sequence + kKept <= last_.back().first) {
            late_[sequence] = revision;
            return;
        }
        last_.insert(std::ranges::lower_bound(last_, sequence, {}, &Entry::first),
                     {sequence, revision});
        if (last_.size() > 2 * kKept)
            last_.erase(last_.begin(), last_.end() - std::ptrdiff_t(kKept));
    }
    /// M14: returns whether the store may have forgotten commits of the client after `seen`, the
    /// revision up to which the client knows the history.
    [[nodiscard]] bool mayLack(Revision seen) const { return wasUnknown_ && seen < forgottenUpTo_; }

private:
    static constexpr std::size_t kKept = 1'024;  // the same number as in the store
    std::vector<Entry> last_;                    // sorted by number
    std::map<std::uint64_t, Revision> late_;     // numbers too low for last_
    bool wasUnknown_;
    Revision forgottenUpTo_;
};

}  // namespace usdlive::server
