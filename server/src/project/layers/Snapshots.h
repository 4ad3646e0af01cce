// Snapshots of layers, which the store keeps in addition to their commits.
#pragma once

#include <deque>
#include <optional>
#include <unordered_map>

#include "project/Wiring.h"
#include "project/layers/LayerListener.h"
#include "project/lines/HistoryLine.h"

namespace usdlive::server {

/// Takes a snapshot of a layer when loading it from its commits alone would take long. Passes it to
/// the store when all its commits are durable.
class Snapshots : public LineListener, public LayerListener {
public:
    struct Limits {
        std::size_t leastReplay = kLeastReplay;  ///< see snapshotDue()
        std::int64_t intervalMs = 10'000;        ///< least time between two snapshots of a layer
    };
    Snapshots(const Limits& limits, const HistoryLine& line, ports::History& history,
              ports::Clock& clock)
        : limits_(limits), line_(line), history_(history), clock_(clock) {}

    /// Returns the estimated number of bytes to read for loading the layer: its snapshot and the
    /// commits since.
    [[nodiscard]] std::size_t storedBytes(const LayerId& layer) const;

    /// Answer of ports::History.
    void kept(const LayerId& layer, const Result<std::size_t>& bytes);

    void ordered(const OrderedCommit& commit) override;
    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void ready(const LayerId& layer, bool imported) override;
    void removed(const LayerId& layer) override { layers_.erase(layer); }

private:
    struct Entry {
        std::size_t replayCost = 0;  ///< cost of the commits since the last snapshot
        std::size_t bytes = 0;       ///< size of the last stored snapshot
        bool isTaken = false;        ///< a snapshot waits for its revision, or for the store
        std::optional<std::int64_t> takenMs;  ///< time of the last snapshot
    };
    /// A snapshot that waits until its revision is durable.
    struct Pending {
        LayerId layer;
        LayerDoc doc;
        Revision revision = 0;
        Hash hash;  ///< hash of the chain at the revision
    };
    void takeIfDue(const LayerId& layer, Entry& entry);

    Limits limits_;
    Wire<const HistoryLine> line_;
    Wire<ports::History> history_;
    Wire<ports::Clock> clock_;
    std::unordered_map<LayerId, Entry> layers_;
    std::deque<Pending> pending_;  ///< sorted by revision
};

}  // namespace usdlive::server
