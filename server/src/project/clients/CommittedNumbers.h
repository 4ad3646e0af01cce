// Which transactions of a client are committed (M9).
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// M9: which transactions of one client are committed, as the store would say. Begins with what the
/// store said and follows from there.
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
    /// M14: the store may have forgotten commits of the client that the client, which had seen this
    /// revision when it came, has not seen.
    [[nodiscard]] bool mayLack(Revision seen) const { return wasUnknown_ && seen < forgottenUpTo_; }

private:
    static constexpr std::size_t kKept = 1'024;  // as the store
    std::vector<Entry> last_;                    // by number
    std::map<std::uint64_t, Revision> late_;  // so far below the others that those do not hold it
    bool wasUnknown_;
    Revision forgottenUpTo_;
};

}  // namespace usdlive::server
