// Layers that no session has open leave the memory.
#pragma once

#include <map>
#include <set>

#include "Wiring.h"
#include "access/AccessPolicy.h"
#include "clients/Submissions.h"
#include "files/Reloads.h"
#include "files/Saves.h"
#include "layers/FileStates.h"
#include "layers/LayerTable.h"
#include "layers/Snapshots.h"
#include "sessions/SessionTable.h"

namespace usdlive::server {

/// Unloads layers that no session has had open for some time, or earlier where all of them take
/// much. What is known of them beside their content stays; they are loaded again when they are
/// needed.
class IdleLayers : public LayerListener, public SessionListener {
public:
    struct Limits {
        std::int64_t layerMs = 60'000;
        std::size_t bytes = 256ull << 20;  ///< of all idle layers, about
    };
    struct Parts {
        const HistoryLine& line;
        LayerTable& layers;
        const FileStates& files;
        const Snapshots& snapshots;
        const SessionTable& sessions;
        const AccessPolicy& access;
        // Those that need layers nobody has open:
        const Submissions& submissions;
        const Saves& saves;
        const Reloads& reloads;
    };
    IdleLayers(const Limits& limits, const Parts& parts, ports::Clock& clock,
               ProjectCounters& counters);

    /// To be called now and then. The layer that was left first goes first; one that is needed has
    /// its turn later.
    void unload();

    void ready(const LayerId& layer, bool /*imported*/) override { add(layer); }
    void openChanged(const LayerId& layer) override { add(layer); }

private:
    /// A loaded layer that no session had open when it was added.
    struct Idle {
        LayerId layer;
        std::int64_t sinceMs = 0;
        std::size_t bytes = 0;  ///< that it takes in memory, about
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

    std::map<std::uint64_t, Idle> idle_;  ///< in the order in which they were added
    std::set<LayerId> added_;             ///< the layers of idle_
    std::uint64_t last_ = 0;
    std::size_t bytes_ = 0;  ///< of all of them
};

}  // namespace usdlive::server
