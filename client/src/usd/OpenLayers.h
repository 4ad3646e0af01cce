// The layers of a client that are live, and how a layer becomes live and stops being live.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "session/Session.h"
#include "usd/BigValues.h"
#include "usd/EditorEvents.h"
#include "usd/LayerPlaces.h"
#include "usd/LiveSet.h"
#include "usd/LoadedLayers.h"
#include "usd/LostWorkReports.h"
#include "usdlive/client/usd/LoadSet.h"

namespace usdlive::client {

/// Knows the layers of the project and those of them that are live here. None of its functions
/// waits for the server: a layer that was joined is filled by later ticks.
class OpenLayers {
public:
    /// All of it outlives this.
    struct Surroundings {
        Session& session;
        LayerPlaces& places;
        EditorEvents& events;
        LostWorkReports& lost;
        BigValues& values;
        usd::BlobSink& sink;  ///< for arrays that the editor writes
        Worker& filler;       ///< makes the content of layers
        Worker& background;   ///< looks for loaded layers
        UserName user;
    };
    explicit OpenLayers(Surroundings surroundings);

    [[nodiscard]] LiveSet& live() { return live_; }
    [[nodiscard]] LiveLayer* find(const LayerId& id) const { return live_.find(id); }
    /// The live layer's name, if it is one of this client.
    [[nodiscard]] std::optional<LayerId> idOf(const pxr::SdfLayerHandle& layer) const;

    // The project.
    /// Sorted.
    [[nodiscard]] const std::vector<LayerId>& ofProject() const { return ofProject_; }
    [[nodiscard]] bool isOfProject(const LayerId& id) const;
    void setOfProject(std::vector<LayerId> layers);

    // Opening.
    /// Makes a layer of this client's own place live. LayerNotFound, LayerUnreadable, or
    /// InvalidArgument when it is live through another connection.
    Result<void> open(const LayerId& id);
    /// Makes an SdfLayer live that the editor has opened.
    Result<void> join(const LayerId& id, const pxr::SdfLayerRefPtr& layer);
    /// Opens the layers of the project that `live`, which is filled, uses. Looks at all of its
    /// specs, but not again until its uses change.
    const std::vector<LayerId>& openUsed(LiveLayer& live, LoadSet load);
    /// Have the layers that it uses been opened with it?
    [[nodiscard]] bool hasUsed(const LayerId& id, LoadSet load) const;
    /// The server cannot give the layer: it is not opened again by itself until the project has
    /// other layers.
    void failed(const LayerId& id);
    /// Layers of the project that this process has loaded and that are not live, sorted.
    [[nodiscard]] std::vector<std::pair<LayerId, pxr::SdfLayerRefPtr>> loadedHere() const;
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] bool isLiveElsewhere(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] static Error liveElsewhere(const LayerId& id);

    // Closing.
    /// The layer stops being live and keeps its content; the session still follows it.
    void leave(LayerId id);
    void leaveAll();
    /// The same at the editor's wish: the session forgets the layer.
    void close(const LayerId& id);

    // Parts of a tick.
    /// Makes layers live that the editor's composition has opened meanwhile.
    void adoptLoaded(double budgetMs);
    /// Brings content in that is made. Returns how many layers still wait for theirs.
    std::size_t fill(double budgetMs);
    /// Makes layers findable that edits of this tick name: composition opens them when the change
    /// block ends.
    void makeNamedFindable();
    /// Sets `permissionToEdit` by the lock that the server reports.
    void followLock(const LayerId& id);
    void followLocks();

private:
    [[nodiscard]] std::vector<std::pair<std::string, LayerId>> usedBy(const LiveLayer& live,
                                                                      LoadSet load) const;

    const Surroundings with_;
    std::vector<LayerId> ofProject_;
    LiveSet live_;
    LoadedLayers loaded_;
    struct Used {
        LoadSet load;
        std::vector<LayerId> layers;
    };
    std::map<LayerId, Used> used_;  // by live layers whose used layers were opened with them
    std::set<LayerId> guessed_;     // made findable though the project did not have them
    std::set<LayerId> failed_;      // not adopted again until the project has other layers
    std::set<LayerId> closed_;      // by the editor: not adopted again
};

}  // namespace usdlive::client
