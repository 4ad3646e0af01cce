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

/// The stage that layers are worked with, whoever composes it. Used from one thread, the stage's.
/// Muteness and edit target may change by other ways than this; they are looked at once per frame.
class StageHost {
public:
    virtual ~StageHost() = default;

    [[nodiscard]] virtual pxr::SdfLayerHandle rootLayer() const = 0;
    /// Null: the stage has none.
    [[nodiscard]] virtual pxr::SdfLayerHandle sessionLayer() const = 0;

    /// Identifiers of the layers that this stage leaves out.
    [[nodiscard]] virtual std::vector<std::string> mutedLayers() const = 0;
    /// One change of the stage. What cannot be muted (the root layer) is passed over.
    virtual void muteAndUnmute(const std::vector<std::string>& mute,
                               const std::vector<std::string>& unmute) = 0;

    [[nodiscard]] virtual pxr::SdfLayerHandle editTarget() const = 0;
    /// False: the layer is not one of the local layer stack.
    virtual bool setEditTarget(const pxr::SdfLayerHandle& layer) = 0;

    /// All layers that contribute: local ones, references, payloads.
    [[nodiscard]] virtual std::vector<pxr::SdfLayerHandle> usedLayers() const = 0;

    /// Names as composed; of a prim that is not there, none.
    [[nodiscard]] virtual std::vector<pxr::TfToken> childNames(const pxr::SdfPath& prim) const = 0;
    [[nodiscard]] virtual std::vector<pxr::TfToken> propertyNames(
        const pxr::SdfPath& prim) const = 0;

    /// What the host composes with, kept up to date by it. Null: it composes elsewhere.
    [[nodiscard]] virtual stage::Composition* composition() const { return nullptr; }
};

}  // namespace usdlive::layers
