// Loads the data that a transaction needs to be executed.
#pragma once

#include <set>
#include <variant>

#include "project/Wiring.h"
#include "project/clients/Authors.h"
#include "project/layers/LayerTable.h"
#include "project/lines/HistoryStart.h"
#include "project/stream/BigValues.h"
#include "project/stream/CommitReads.h"

namespace usdlive::server {

/// A transaction that waits to be executed.
struct QueuedTransaction {
    Transaction transaction;
    std::size_t bytes = 0;  ///< size as received
    /// Transactions whose creations were requested from the store.
    std::set<std::uint64_t> lookedUp;
    std::set<Hash> soughtBlobs;  ///< big values that were requested from the store
};

/// Requests the data that a transaction needs: its layers, the specs that its author created before
/// (M3), and whether its big values are stored (V9).
class Prerequisites {
public:
    Prerequisites(const HistoryLine& line, const HistoryStart& start, LayerTable& layers,
                  BigValues& values, CommitReads& reads)
        : line_(line), start_(start), layers_(layers), values_(values), reads_(reads) {}

    /// Returns true if everything is in memory. Returns false if something was requested; call it
    /// again after each answer. Returns the refusal if the transaction cannot be executed.
    std::variant<bool, Refused> check(SessionId session, const Author& author,
                                      QueuedTransaction& queued);
    /// Receives the commit of an earlier transaction of the author, read from the store.
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
