// How parts of a project follow a line of history.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive::server {

/// A commit of a line of history: executed, and handed to the log.
struct OrderedCommit {
    Revision revision = 0;
    SharedBytes broadcast;  ///< its frames as they are sent to sessions; a stub for an import (CH2)
    Hash hash;              ///< chain hash after it
    TransactionId id;       ///< sequence 0: it is no client's transaction
    UserName user;
    std::uint64_t gesture = 0;
    std::size_t edits = 0, dropped = 0;
    std::size_t frameBytes = 0;   ///< in the log
    std::set<LayerId> layers;     ///< that it edits, or brings in
    std::set<LayerId> layerData;  ///< of them, whose custom layer data it changes
    std::vector<Hash> blobs;      ///< that it names
    std::optional<LayerId> imported;
    std::uint64_t mark = 0;  ///< of the NamespaceLog before it
};

/// Commits that the log could not append, in order.
struct LostCommits {
    std::vector<OrderedCommit> commits;
    std::set<LayerId> changed;   ///< layers that one of them edits or brings in
    std::set<LayerId> imported;  ///< layers that one of them brings in
};

/// A part that follows a line of history. Each part that keeps something until a revision is
/// durable learns here that it is, and repairs here what it keeps when commits are rolled back.
class LineListener {
public:
    virtual ~LineListener() = default;

    /// The commit was executed and gets its place in the order. It may still be rolled back.
    virtual void ordered(const OrderedCommit& /*commit*/) {}
    /// The commit is durable. Called for each commit, in order.
    virtual void durable(const OrderedCommit& /*commit*/) {}
    /// Everything up to this revision is durable. Called once after a group of commits, and after
    /// rolledBack().
    virtual void becameDurable(Revision /*upTo*/) {}
    /// These commits never were. The line's documents that they changed were dropped.
    virtual void rolledBack(const Error& /*error*/, const LostCommits& /*lost*/) {}
};

}  // namespace usdlive::server
