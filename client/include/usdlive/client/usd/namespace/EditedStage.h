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

/// Which parts of its layers a stage composes.
struct StageView {
    /// UsdStageLoadRules: whether payloads at a path and below are loaded.
    enum class Load { All, Only, None };

    std::vector<std::string> muted;          ///< identifiers of layers
    std::map<pxr::SdfPath, Load> loadRules;  ///< none: all payloads are loaded
    std::vector<pxr::SdfPath> mask;          ///< a population mask; none: all prims
    pxr::PcpVariantFallbackMap variantFallbacks;

    bool operator==(const StageView&) const = default;
    [[nodiscard]] bool isLoaded(const pxr::SdfPath& prim) const;
    /// Is `prim` in the mask, or above or below what is in it?
    [[nodiscard]] bool includes(const pxr::SdfPath& prim) const;
};

/// What a NamespaceEditor asks of the stage that it edits. The editor composes the stage's layers
/// itself. One thread, the one that owns the layers.
class EditedStage {
public:
    virtual ~EditedStage() = default;

    /// Null: the stage is gone.
    [[nodiscard]] virtual pxr::SdfLayerHandle rootLayer() const = 0;
    /// Null: the stage has none.
    [[nodiscard]] virtual pxr::SdfLayerHandle sessionLayer() const = 0;
    [[nodiscard]] virtual StageView view() const { return {}; }

    struct EditTarget {
        pxr::SdfLayerHandle layer;  ///< null: the root layer
        bool mapsPaths = false;     ///< it leads into a variant or over an arc
    };
    [[nodiscard]] virtual EditTarget editTarget() const { return {}; }

    /// Do schemas define `property` for a prim of `typeName` to which `apiSchemas` are applied?
    [[nodiscard]] virtual bool isBuiltIn(const pxr::TfToken& typeName,
                                         const pxr::TfTokenVector& apiSchemas,
                                         const pxr::TfToken& property) const = 0;
    /// Is there a prim at `path` that belongs to the prototype of instances?
    [[nodiscard]] virtual bool isInPrototype(const pxr::SdfPath&) const { return false; }
};

/// A composed stage of this library. It may be closed before.
[[nodiscard]] std::unique_ptr<EditedStage> editedStage(stage::Stage& stage);

}  // namespace usdlive
