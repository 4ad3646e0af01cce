// The interface by which parts of a project follow a line of history.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive::server {

/// A commit of a line of history that was executed and passed to the log.
struct OrderedCommit {
    Revision revision = 0;
    SharedBytes broadcast;  ///< its frames for sessions; a stub for an import (CH2)
    /// Its content, if it may fit into a compact frame (FR9).
    std::shared_ptr<const CompactCommit> content;
    /// For its author, if it has exactly the edits that were submitted (FR11).
    std::optional<Acceptance> acceptance;
    Hash hash;         ///< hash of the chain up to and including it
    TransactionId id;  ///< sequence 0: not a transaction of a client
    UserName user;
    std::uint64_t gesture = 0;
    std::size_t edits = 0, dropped = 0;
    std::size_t frameBytes = 0;   ///< size in the log
    std::set<LayerId> layers;     ///< layers that it edits or imports
    std::set<LayerId> layerData;  ///< the layers whose custom layer data it changes
    std::vector<Hash> blobs;      ///< big values that it names
    std::optional<LayerId> imported;
    std::uint64_t mark = 0;  ///< position in the NamespaceLog before it
};

/// Commits that the log could not append, in order.
struct LostCommits {
    std::vector<OrderedCommit> commits;
    std::set<LayerId> changed;   ///< layers that one of them edits or imports
    std::set<LayerId> imported;  ///< layers that one of them imports
};

/// A part that follows a line of history. A part that keeps data until a revision is durable is
/// notified here when it is, and corrects its data here when commits are rolled back.
class LineListener {
public:
    virtual ~LineListener() = default;

    /// Called when a commit was executed and ordered. It may still be rolled back.
    virtual void ordered(const OrderedCommit& /*commit*/) {}
    /// Called for each commit that became durable, in order.
    virtual void durable(const OrderedCommit& /*commit*/) {}
    /// Called once after a group of commits became durable, and after rolledBack(). All commits up
    /// to this revision are durable.
    virtual void becameDurable(Revision /*upTo*/) {}
    /// Called when commits were rolled back. The line has dropped the documents that they changed.
    virtual void rolledBack(const Error& /*error*/, const LostCommits& /*lost*/) {}
};

}  // namespace usdlive::server
