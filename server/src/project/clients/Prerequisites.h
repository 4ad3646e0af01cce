// Loads what has to be in memory before a transaction can be executed.
#pragma once

#include <set>
#include <variant>

#include "Wiring.h"
#include "clients/Authors.h"
#include "layers/LayerTable.h"
#include "lines/HistoryStart.h"
#include "stream/BigValues.h"
#include "stream/CommitReads.h"

namespace usdlive::server {

/// A transaction that waits to be executed.
struct QueuedTransaction {
    Transaction transaction;
    std::size_t bytes = 0;             ///< as it came
    std::set<std::uint64_t> lookedUp;  ///< transactions whose creations were asked of the store
    std::set<Hash> soughtBlobs;        ///< big values that were asked of the store
};

/// Has loaded what a transaction needs: its layers, what its author created before (M3), and
/// whether its big values are stored (V9).
class Prerequisites {
public:
    Prerequisites(const HistoryLine& line, const HistoryStart& start, LayerTable& layers,
                  BigValues& values, CommitReads& reads)
        : line_(line), start_(start), layers_(layers), values_(values), reads_(reads) {}

    /// True: all is there. False: it was asked for, and the transaction has to be asked about again
    /// when an answer has come.
    std::variant<bool, Refused> check(SessionId session, const Author& author,
                                      QueuedTransaction& queued);
    /// The store has read the commit of an author's earlier transaction.
    void addCreations(Author& author, std::uint64_t sequence, const StoredCommit& stored);

private:
    std::variant<bool, Refused> blobsReady(QueuedTransaction& queued);
    std::variant<bool, Refused> layersReady(const Transaction& transaction);
    bool creationsKnown(SessionId session, const Author& author, QueuedTransaction& queued);

    Wire<const HistoryLine> line_;
    Wire<const HistoryStart> start_;
    Wire<LayerTable> layers_;
    Wire<BigValues> values_;
    Wire<CommitReads> reads_;
};

}  // namespace usdlive::server
