// Removes layers that no session has open from memory.
#pragma once

#include <map>
#include <set>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/clients/Submissions.h"
#include "project/files/Reloads.h"
#include "project/files/Saves.h"
#include "project/layers/FileStates.h"
#include "project/layers/LayerTable.h"
#include "project/layers/Snapshots.h"
#include "project/sessions/SessionTable.h"

namespace usdlive::server {

/// Removes layers from memory that no session has had open for some time, or earlier if they use
/// too much memory together. Their other states stay in memory. They are loaded again when they are
/// needed.
class IdleLayers : public LayerListener, public SessionListener {
public:
    struct Limits {
        std::int64_t layerMs = 60'000;
        std::size_t bytes = 256ull << 20;  ///< approximate memory of all idle layers
    };
    struct Parts {
        const HistoryLine& line;
        LayerTable& layers;
        const FileStates& files;
        const Snapshots& snapshots;
        const SessionTable& sessions;
        const AccessPolicy& access;
        // The parts that may need layers that no session has open:
        const Submissions& submissions;
        const Saves& saves;
        const Reloads& reloads;
    };
    IdleLayers(const Limits& limits, const Parts& parts, ports::Clock& clock,
               ProjectCounters& counters);

    /// Removes idle layers, those that are idle for the longest time first. Skips layers that are
    /// needed. Call it regularly.
    void unload();

    void ready(const LayerId& layer, bool /*imported*/) override { add(layer); }
    void openChanged(const LayerId& layer) override { add(layer); }

private:
    /// A loaded layer that no session had open when it was added.
    struct Idle {
        LayerId layer;
        std::int64_t sinceMs = 0;
        std::size_t bytes = 0;  ///< approximate memory of the layer
    };
    void add(const LayerId& layer);
    [[nodiscard]] bool isNeeded(const LayerId& layer) const;
    [[nodiscard]] std::set<LayerId> lockingStacks() const;

    Limits limits_;
    Wire<const HistoryLine> line_;
    Wire<LayerTable> layers_;
    Wire<const FileStates> files_;
    Wire<const Snapshots> snapshots_;
    Wire<const SessionTable> sessions_;
    Wire<const AccessPolicy> access_;
    Wire<const Submissions> submissions_;
    Wire<const Saves> saves_;
    Wire<const Reloads> reloads_;
    Wire<ports::Clock> clock_;
    Wire<ProjectCounters> counters_;

    std::map<std::uint64_t, Idle> idle_;  ///< layers in the order in which they became idle
    std::set<LayerId> added_;             ///< the layers of idle_
    std::uint64_t last_ = 0;
    std::size_t bytes_ = 0;  ///< memory of all of them
};

}  // namespace usdlive::server
