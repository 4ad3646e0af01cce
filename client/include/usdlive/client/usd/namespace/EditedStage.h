// Declares EditedStage, the interface through which a NamespaceEditor reads the stage that it
// edits.
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/pcp/types.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace usdlive {

namespace stage {
class Stage;
}

/// The parts of a stage's layers that are composed. A value type.
struct StageView {
    /// The load rule of a path. Corresponds to UsdStageLoadRules.
    enum class Load { All, Only, None };

    std::vector<std::string> muted;          ///< identifiers of layers that are left out
    std::map<pxr::SdfPath, Load> loadRules;  ///< if it is empty, all payloads
    std::vector<pxr::SdfPath> mask;          ///< the population mask; if it is empty, all prims
    pxr::PcpVariantFallbackMap variantFallbacks;

    bool operator==(const StageView&) const = default;
    /// Returns true if the payload of `prim` is loaded.
    [[nodiscard]] bool isLoaded(const pxr::SdfPath& prim) const;
    /// Returns true if `prim` is in the mask, or above or below a prim in it.
    [[nodiscard]] bool includes(const pxr::SdfPath& prim) const;
};

/// A stage as a NamespaceEditor sees it. The editor composes the stage's layers itself. It calls
/// these functions only on its own thread, which is the thread that owns the layers.
class EditedStage {
public:
    virtual ~EditedStage() = default;

    /// Returns null if the stage no longer exists.
    [[nodiscard]] virtual pxr::SdfLayerHandle rootLayer() const = 0;
    /// Returns null if the stage has no session layer.
    [[nodiscard]] virtual pxr::SdfLayerHandle sessionLayer() const = 0;
    /// Returns the muted layers, load rules and mask of the stage.
    [[nodiscard]] virtual StageView view() const { return {}; }

    struct EditTarget {
        pxr::SdfLayerHandle layer;  ///< null for the root layer
        bool mapsPaths = false;     ///< true if the target leads into a variant or over an arc
    };
    [[nodiscard]] virtual EditTarget editTarget() const { return {}; }

    /// Returns true if schemas define `property` for a prim of type `typeName` with the applied
    /// `apiSchemas`.
    [[nodiscard]] virtual bool isBuiltIn(const pxr::TfToken& typeName,
                                         const pxr::TfTokenVector& apiSchemas,
                                         const pxr::TfToken& property) const = 0;
    /// Returns true if a prim at this path belongs to a prototype.
    [[nodiscard]] virtual bool isInPrototype(const pxr::SdfPath&) const { return false; }
};

/// Returns the view that an editor has of a composed stage. The stage may be destroyed first; the
/// editor then refuses all edits.
[[nodiscard]] std::unique_ptr<EditedStage> editedStage(stage::Stage& stage);

}  // namespace usdlive
