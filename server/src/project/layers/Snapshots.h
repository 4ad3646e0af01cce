// When a layer's content is kept in the store beside its commits.
#pragma once

#include <deque>
#include <optional>
#include <unordered_map>

#include "Wiring.h"
#include "layers/LayerListener.h"
#include "lines/HistoryLine.h"

namespace usdlive::server {

/// Takes a snapshot of a layer when it would take long to load it from its commits alone. The store
/// keeps it once everything in it is durable.
class Snapshots : public LineListener, public LayerListener {
public:
    struct Limits {
        std::size_t leastReplay = kLeastReplay;  ///< see snapshotDue()
        std::int64_t intervalMs = 10'000;        ///< from one snapshot of a layer to the next
    };
    Snapshots(const Limits& limits, const HistoryLine& line, ports::History& history,
              ports::Clock& clock)
        : limits_(limits), line_(line), history_(history), clock_(clock) {}

    /// About how many bytes have to be read to load the layer: its snapshot and the commits since.
    [[nodiscard]] std::size_t storedBytes(const LayerId& layer) const;

    /// Answer of the port.
    void kept(const LayerId& layer, const Result<std::size_t>& bytes);

    void ordered(const OrderedCommit& commit) override;
    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void loaded(const LayerId& layer, const LoadedLayer& loaded) override;
    void ready(const LayerId& layer, bool imported) override;
    void removed(const LayerId& layer) override { layers_.erase(layer); }

private:
    struct Entry {
        std::size_t replayCost = 0;           ///< of its commits since a snapshot was taken
        std::size_t bytes = 0;                ///< of the last one that was kept
        bool isTaken = false;                 ///< one waits for its revision, or for the store
        std::optional<std::int64_t> takenMs;  ///< when the last one was taken
    };
    /// Waits for its revision to be durable.
    struct Pending {
        LayerId layer;
        LayerDoc doc;
        Revision revision = 0;
        Hash hash;  ///< chain hash at the revision
    };
    void takeIfDue(const LayerId& layer, Entry& entry);

    Limits limits_;
    Wire<const HistoryLine> line_;
    Wire<ports::History> history_;
    Wire<ports::Clock> clock_;
    std::unordered_map<LayerId, Entry> layers_;
    std::deque<Pending> pending_;  ///< by revision
};

}  // namespace usdlive::server
