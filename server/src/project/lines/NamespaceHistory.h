// The moves and deletes of a line of history.
#pragma once

#include <deque>
#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// The moves and deletes that addresses are carried over (M3), with the revision each entry is of.
class NamespaceHistory {
public:
    /// `changes`: those of the revisions after `oldest`, up to `newest`.
    NamespaceHistory(Revision oldest, Revision newest, const std::vector<NamespaceChange>& changes);

    [[nodiscard]] NamespaceLog& log() { return log_; }
    [[nodiscard]] const NamespaceLog& log() const { return log_; }

    /// To be called when `revision` was executed with log().
    void executed(Revision revision);
    /// Takes back what was executed since log() had this mark.
    void truncate(std::uint64_t mark);
    void prune(Revision revision);

    /// Number of the first entry of `revision` or a later one.
    [[nodiscard]] std::uint64_t markBefore(Revision revision) const;

private:
    NamespaceLog log_;
    std::deque<Revision> revisions_;  // of the log's entries
    std::uint64_t end_ = 0;           // number of the entry after the last of revisions_
};

}  // namespace usdlive::server
