// The moves and deletes of a line of history.
#pragma once

#include <deque>
#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// The moves and deletes over which addresses are carried forward (M3), each with its revision.
class NamespaceHistory {
public:
    /// `changes` are those of the revisions after `oldest`, up to `newest`.
    NamespaceHistory(Revision oldest, Revision newest, const std::vector<NamespaceChange>& changes);

    [[nodiscard]] NamespaceLog& log() { return log_; }
    [[nodiscard]] const NamespaceLog& log() const { return log_; }

    /// Call it when `revision` was executed with log().
    void executed(Revision revision);
    /// Removes the entries that were added since log() had this mark.
    void truncate(std::uint64_t mark);
    void prune(Revision revision);

    /// Returns the number of the first entry of `revision` or a later one.
    [[nodiscard]] std::uint64_t markBefore(Revision revision) const;

private:
    NamespaceLog log_;
    std::deque<Revision> revisions_;  // revisions of the log's entries
    std::uint64_t end_ = 0;           // number of the entry after the last one of revisions_
};

}  // namespace usdlive::server
