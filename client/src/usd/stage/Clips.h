// Declares value clips: layers that contribute time samples to a prim and to the prims below it.
#pragma once

#include <pxr/base/gf/vec2d.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/usd/stage/AttributeQuery.h"

namespace usdlive::stage {

/// The metadata of one clip set after composition. Times are times of the stage.
struct ClipDefinition {
    std::string name;
    // The strongest opinion about asset paths. Its layer anchors them.
    pxr::PcpLayerStackPtr stack;
    pxr::SdfLayerHandle layer;
    pxr::SdfPath prim;
    std::size_t order = 0;  // among the sets of the prim in its layer stack
    std::optional<pxr::SdfAssetPath> manifest;
    pxr::VtArray<pxr::SdfAssetPath> assets;
    std::string clipPrim;
    pxr::VtVec2dArray active;  // (time of the stage, index in `assets`)
    pxr::VtVec2dArray times;   // (time of the stage, time of the clip)
    bool interpolatesMissing = false;

    friend bool operator==(const ClipDefinition& one, const ClipDefinition& other);
};

/// Composes the clip sets that are authored on a prim, from strong to weak. Sets that cannot be
/// used are left out with a warning, as in pxr.Usd.
[[nodiscard]] std::vector<ClipDefinition> composeClips(const pxr::PcpPrimIndex& index);

/// The layers of the clips of a stage. They stay open as long as the stage, so that edits that are
/// not saved are kept. Several threads may call open() at once.
class ClipLayers {
public:
    /// Opens a layer. Returns null with a warning if it cannot be opened.
    [[nodiscard]] pxr::SdfLayerRefPtr open(const ClipDefinition& definition,
                                           const std::string& assetPath);
    /// Returns the layers that are open.
    [[nodiscard]] pxr::SdfLayerHandleSet open();
    /// Keeps a set, to find the clips of a changed layer.
    void add(const std::shared_ptr<ClipSet>& set);
    /// Returns the sets that have opened this layer.
    [[nodiscard]] std::vector<std::shared_ptr<ClipSet>> usersOf(const pxr::SdfLayerHandle& layer);

private:
    std::mutex mutex_;                                   // guards both
    std::map<std::string, pxr::SdfLayerRefPtr> layers_;  // by identifier
    std::set<const pxr::SdfLayer*> known_;               // the same
    std::vector<std::weak_ptr<ClipSet>> sets_;
    std::size_t living_ = 0;  // size of sets_ when expired ones were last removed
};

/// One clip set. Layers are opened when a value needs them; without a manifest the first value
/// opens all of them. Several threads may read at once.
class ClipSet {
public:
    ClipSet(ClipDefinition definition, std::shared_ptr<ClipLayers> layers);

    [[nodiscard]] const ClipDefinition& definition() const { return definition_; }
    /// Returns true if the set takes part in value resolution behind this layer of this node, for
    /// an attribute with this path in the node's layer stack.
    [[nodiscard]] bool appliesTo(const pxr::PcpNodeRef& node) const;
    [[nodiscard]] bool hasValuesOf(const pxr::SdfPath& attribute) const;
    /// Returns the times of all samples in ascending order.
    [[nodiscard]] std::vector<double> timesOf(const pxr::SdfPath& attribute) const;
    [[nodiscard]] bool mightVary(const pxr::SdfPath& attribute) const;
    /// Returns the value at a time in the form of the clip's layer, and writes this layer to
    /// `layer`. Returns an empty value if there is none.
    [[nodiscard]] pxr::VtValue value(const pxr::SdfPath& attribute, double time,
                                     Interpolation interpolation, pxr::SdfLayerRefPtr& layer) const;

    /// Returns the path of the stage's layers that a path in a clip contributes to, or an empty
    /// path.
    [[nodiscard]] pxr::SdfPath fromClip(const pxr::SdfPath& path) const;
    [[nodiscard]] bool uses(const pxr::SdfLayerHandle& layer) const;
    /// Returns true if another value of a clip in this layer can change values of the attribute.
    [[nodiscard]] bool mayShow(const pxr::SdfLayerHandle& layer,
                               const pxr::SdfPath& attribute) const;
    /// Called when one of the layers has changed.
    void onLayerChanged();

private:
    // Samples after `start` belong to the clip, up to the start of the next clip.
    struct Clip {
        pxr::SdfAssetPath asset;
        double authored = 0, start = 0, end = 0;
        mutable std::optional<pxr::SdfLayerRefPtr> layer;

        [[nodiscard]] bool isActiveAt(double time) const { return time >= start && time < end; }
    };
    struct Mapping {
        double stage = 0, clip = 0;
        bool jumps = false;  // to the next mapping, which has the same time
    };

    [[nodiscard]] pxr::SdfLayerRefPtr layerOf(const Clip& clip) const;
    [[nodiscard]] pxr::SdfLayerRefPtr manifest() const;
    [[nodiscard]] const std::map<pxr::SdfPath, bool>& declared() const;
    [[nodiscard]] std::size_t activeAt(double time) const;
    [[nodiscard]] bool contributes(const Clip& clip, const pxr::SdfPath& attribute) const;
    [[nodiscard]] std::vector<double> timesIn(const Clip& clip,
                                              const pxr::SdfPath& attribute) const;
    [[nodiscard]] std::vector<double> timesInLayer(const Clip& clip,
                                                   const pxr::SdfPath& attribute) const;
    [[nodiscard]] double shownAfter(const Clip& clip, const pxr::SdfPath& attribute,
                                    double time) const;
    [[nodiscard]] std::pair<double, double> bracket(const pxr::SdfPath& attribute,
                                                    double time) const;
    [[nodiscard]] double toClip(double time) const;
    [[nodiscard]] double toStage(double time, std::size_t segment) const;
    [[nodiscard]] pxr::SdfPath inClip(const pxr::SdfPath& path) const;
    [[nodiscard]] pxr::VtValue sample(const pxr::SdfPath& attribute, double time,
                                      Interpolation interpolation,
                                      pxr::SdfLayerRefPtr& layer) const;

    const ClipDefinition definition_;
    const pxr::SdfPath clipPrim_;
    const std::shared_ptr<ClipLayers> layers_;
    std::vector<Clip> clips_;
    std::vector<Mapping> mappings_;
    mutable std::recursive_mutex mutex_;  // guards the layers of the clips and both below
    mutable std::optional<pxr::SdfLayerRefPtr> manifest_;
    // The attributes of the clips without a manifest; true for those that vary.
    mutable std::optional<std::map<pxr::SdfPath, bool>> declared_;
};

}  // namespace usdlive::stage
