// The interface to the stage whose layers are edited.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <string>
#include <vector>

namespace usdlive::stage {
class Composition;
}

namespace usdlive::layers {

/// The stage whose layers are edited, independent of who composes it. Used on the stage's thread
/// only. Muteness and edit target may also be changed by other means; they are checked once per
/// frame.
class StageHost {
public:
    virtual ~StageHost() = default;

    [[nodiscard]] virtual pxr::SdfLayerHandle rootLayer() const = 0;
    /// Returns null if the stage has none.
    [[nodiscard]] virtual pxr::SdfLayerHandle sessionLayer() const = 0;

    /// Returns the identifiers of the muted layers.
    [[nodiscard]] virtual std::vector<std::string> mutedLayers() const = 0;
    /// Mutes and unmutes with one change of the stage. Ignores layers that cannot be muted, such as
    /// the root layer.
    virtual void muteAndUnmute(const std::vector<std::string>& mute,
                               const std::vector<std::string>& unmute) = 0;

    [[nodiscard]] virtual pxr::SdfLayerHandle editTarget() const = 0;
    /// Returns false if the layer is not in the local layer stack.
    virtual bool setEditTarget(const pxr::SdfLayerHandle& layer) = 0;

    /// Returns all contributing layers: local layers, references, payloads.
    [[nodiscard]] virtual std::vector<pxr::SdfLayerHandle> usedLayers() const = 0;

    /// Returns the composed names, or none for a missing prim.
    [[nodiscard]] virtual std::vector<pxr::TfToken> childNames(const pxr::SdfPath& prim) const = 0;
    [[nodiscard]] virtual std::vector<pxr::TfToken> propertyNames(
        const pxr::SdfPath& prim) const = 0;

    /// Returns the host's composition, which the host keeps up to date. Null if it composes
    /// elsewhere.
    [[nodiscard]] virtual stage::Composition* composition() const { return nullptr; }
};

}  // namespace usdlive::layers
