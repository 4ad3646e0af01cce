// The live layers of a client: how a layer becomes live and stops being live.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "link/EditorEvents.h"
#include "session/Session.h"
#include "usd/assets/ClipFiles.h"
#include "usd/live/LayerViews.h"
#include "usd/live/LiveSet.h"
#include "usd/live/LoadedLayers.h"
#include "usd/live/NeededBigValues.h"
#include "usd/places/LayerPlaces.h"
#include "usdlive/client/usd/LoadSet.h"
#include "work/LostWorkReports.h"

namespace usdlive::client {

/// The layers of the project, and those of them that are live in this client. No function waits for
/// the server: later ticks fill a layer that was joined.
class OpenLayers {
public:
    /// All members outlive this object.
    struct Dependencies {
        Session& session;
        LayerPlaces& places;
        PlainFiles& files;
        EditorEvents& events;
        LostWorkReports& lost;
        NeededBigValues& values;
        BlobSink& sink;      ///< for the editor's big arrays
        Worker& filler;      ///< builds the content of layers
        Worker& background;  ///< searches for loaded layers
    };
    explicit OpenLayers(Dependencies dependencies);

    [[nodiscard]] LiveSet& live() { return live_; }
    [[nodiscard]] LayerViews& views() { return views_; }
    [[nodiscard]] LiveLayer* find(const LayerId& id) const { return live_.find(id); }
    /// Returns the name of the layer if it is a live layer of this client.
    [[nodiscard]] std::optional<LayerId> idOf(const pxr::SdfLayerHandle& layer) const;

    // The project.
    /// Returns the layers of the project, sorted.
    [[nodiscard]] const std::set<LayerId>& ofProject() const;
    [[nodiscard]] bool isOfProject(const LayerId& id) const;
    /// Call it when the layers of the project have changed. `added` were not in it before.
    void projectChanged(const std::vector<LayerId>& added);

    // Opening.
    /// Makes a layer of this client's own place live. Errors: LayerNotFound, LayerUnreadable,
    /// InvalidArgument (it is live through another connection).
    Result<void> open(const LayerId& id);
    /// Makes an SdfLayer live that the editor has already opened.
    Result<void> join(const LayerId& id, const pxr::SdfLayerRefPtr& layer);
    /// Opens the layers of the project that `live` uses. Reads all its specs, but not again until
    /// the used layers may have changed. Precondition: `live` is filled.
    const std::vector<LayerId>& openUsed(LiveLayer& live, LoadSet load);
    /// Returns whether the layers that it uses were opened with it.
    [[nodiscard]] bool hasUsed(const LayerId& id, LoadSet load) const;
    /// Call it when the server could not give the content of the layer. The layer is no longer
    /// live, and refuses edits. What the project does not have is not opened automatically again
    /// until the layers of the project change; anything else may be mended, and is joined again in
    /// pauses. Returns false if the layer had failed for the same reason before.
    bool failed(const LayerId& id, const Error& reason);
    [[nodiscard]] bool isAwaited(const LayerId& id) const { return awaited_.contains(id); }
    /// Returns the layers of the project that this process has loaded and that are not live,
    /// sorted. Without those that are read as files (ClipFiles).
    [[nodiscard]] std::vector<std::pair<LayerId, pxr::SdfLayerRefPtr>> loadedHere() const;
    /// Returns the name of a loaded layer if it is one of those.
    [[nodiscard]] std::optional<LayerId> layerOf(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] bool isLiveElsewhere(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] static Error liveElsewhere(const LayerId& id);

    // Closing.
    /// Makes the layer stop being live. It keeps its content, and the session still follows it.
    void leave(LayerId id);
    void leaveAll();
    /// Does the same at the request of the editor: the session forgets the layer.
    void close(const LayerId& id);

    // Parts of a tick.
    /// Makes layers live that composition has opened meanwhile, and joins layers again that have
    /// failed. Placeholders that cannot be live refuse edits.
    void adoptLoaded(double budgetMs);
    /// Does the same for all loaded layers, at once. For calls that may take long.
    void adoptAllLoaded();
    /// Puts content in that is built. Returns the number of layers that still wait for theirs.
    std::size_t fill(double budgetMs);
    /// Returns the live layers of value clips that were filled since the last call. OpenUSD may
    /// have read them when they were empty.
    [[nodiscard]] std::vector<LayerId> takeFilledClips() { return std::exchange(filledClips_, {}); }
    /// Makes layers findable that edits of this tick name, because composition opens them at the
    /// end of the change block. Those that value clips name are found as files.
    void makeNamedFindable();
    /// Sets `permissionToEdit` according to the lock, the role and the access rules that the server
    /// has reported.
    void followLock(const LayerId& id);
    void followLocks();

private:
    [[nodiscard]] std::vector<std::pair<std::string, LayerId>> usedBy(const LiveLayer& live,
                                                                      LoadSet load) const;

    /// Returns the name of a layer of the project.
    [[nodiscard]] std::optional<LayerId> nameOf(const pxr::SdfLayerHandle& layer) const;
    void openNamed(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets);
    void adopt(const pxr::SdfLayerRefPtr& layer);
    /// Makes the layer of the file live, which `layer` shows. Returns false if it shows none.
    bool adoptView(const pxr::SdfLayerRefPtr& layer);
    [[nodiscard]] bool mayJoin(const LayerId& id) const;
    void refuseEdits(const pxr::SdfLayerHandle& layer) const;
    /// Call it when a layer that the server could not give is not joined again: a file of an
    /// attached folder accepts edits again.
    void abandon(const pxr::SdfLayerRefPtr& layer) const;
    void joinAwaited(std::int64_t nowMs);

    const Dependencies with_;
    bool knowsProject_ = false;
    LiveSet live_;
    ClipFiles clips_;
    LayerViews views_;
    std::vector<LayerId> filledClips_;
    LoadedLayers loaded_;
    struct Used {
        LoadSet load;
        std::vector<LayerId> layers;
    };
    std::map<LayerId, Used> used_;  // by live layer whose used layers were opened with it
    std::set<LayerId> guessed_;     // layers made findable that the project did not have
    std::set<LayerId> failed_;      // not made live again until the project's layers change
    /// A layer that the server could not give. Its SdfLayer stands for it on stages, without
    /// content.
    struct Awaited {
        pxr::SdfLayerRefPtr layer;
        Error reason;
        std::int64_t pauseMs, retryAtMs;
    };
    std::map<LayerId, Awaited> awaited_;
    std::set<LayerId> closed_;  // closed by the editor: not made live again
};

}  // namespace usdlive::client
