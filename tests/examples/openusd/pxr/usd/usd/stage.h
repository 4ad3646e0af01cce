// Declares what the examples use of OpenUSD's UsdStage, as OpenUSD 26.8 does: the OpenUSD that the
// tests build with has no such class. For compiling only.
#pragma once

#include <pxr/base/tf/refBase.h>
#include <pxr/base/tf/refPtr.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include "editTarget.h"
#include "prim.h"

namespace pxr {

class UsdStage;
using UsdStageRefPtr = TfRefPtr<UsdStage>;

class UsdStage : public TfRefBase {
public:
    enum InitialLoadSet { LoadAll, LoadNone };
    static UsdStageRefPtr Open(const SdfLayerHandle& rootLayer, InitialLoadSet load = LoadAll);
    SdfLayerHandle GetRootLayer() const;
    SdfLayerHandle GetSessionLayer() const;
    const std::vector<std::string>& GetMutedLayers() const;
    void MuteAndUnmuteLayers(const std::vector<std::string>& muteLayers,
                             const std::vector<std::string>& unmuteLayers);
    const UsdEditTarget& GetEditTarget() const;
    UsdEditTarget GetEditTargetForLocalLayer(const SdfLayerHandle& layer);
    void SetEditTarget(const UsdEditTarget& editTarget);
    bool HasLocalLayer(const SdfLayerHandle& layer) const;
    SdfLayerHandleVector GetUsedLayers(bool includeClipLayers = true) const;
    UsdPrim GetPrimAtPath(const SdfPath& path) const;
};

}  // namespace pxr
