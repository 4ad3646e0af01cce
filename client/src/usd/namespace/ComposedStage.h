// Declares ComposedStage, the composition that namespace edits are planned on.
#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/instanceKey.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/layerStackIdentifier.h>
#include <pxr/usd/pcp/primIndex.h>
#include <pxr/usd/sdf/notice.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <unordered_map>
#include <unordered_set>

#include "usd/stage/Composition.h"
#include "usdlive/client/usd/namespace/EditedStage.h"

namespace usdlive::naming {

/// The prims of a stage as UsdStage composes them, kept up to date while the layers change. Only
/// one instance of each prototype has its children composed.
///
/// Use it on one thread. After a change on another thread, the next query composes everything
/// again.
class ComposedStage : public pxr::TfWeakBase {
public:
    ComposedStage(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                  const StageView& view);
    /// Composes copies of a stage's layers with the stage's resolver context.
    ComposedStage(pxr::PcpLayerStackIdentifier layers, const StageView& view);
    ~ComposedStage();
    ComposedStage(const ComposedStage&) = delete;
    ComposedStage& operator=(const ComposedStage&) = delete;

    [[nodiscard]] const StageView& view() const { return view_; }
    [[nodiscard]] const pxr::PcpLayerStackIdentifier& layers() const { return layers_; }
    /// Returns the cache, with all prims composed.
    [[nodiscard]] pxr::PcpCache& composed();
    [[nodiscard]] pxr::PcpLayerStackRefPtr localLayers();

    /// Returns the prim at `path`, also below an instance, or null if there is none. Valid until
    /// the layers change.
    [[nodiscard]] const pxr::PcpPrimIndex* prim(const pxr::SdfPath& path);
    /// Returns the reason if the prim at `path` is left out because arcs lead too deep.
    [[nodiscard]] std::string whyLeftOut(const pxr::SdfPath& path);
    [[nodiscard]] bool isInstance(const pxr::SdfPath& path);
    [[nodiscard]] bool isInstanceProxy(const pxr::SdfPath& path);
    [[nodiscard]] static bool isActive(const pxr::PcpPrimIndex& prim);
    [[nodiscard]] static bool hasAuthoredProperty(const pxr::PcpPrimIndex& prim,
                                                  const pxr::TfToken& name);
    [[nodiscard]] static pxr::TfToken typeName(const pxr::PcpPrimIndex& prim);
    [[nodiscard]] static pxr::TfTokenVector apiSchemas(const pxr::PcpPrimIndex& prim);

private:
    void compose();
    void makeComposition();
    bool composesChildren(const pxr::PcpPrimIndex& prim, pxr::TfTokenVector* names);
    void noteChanges(const pxr::PcpChanges& changes);
    void dropOldInstances(const pxr::PcpChanges& changes);
    [[nodiscard]] pxr::SdfPathVector reachable(const pxr::SdfPathSet& paths) const;
    [[nodiscard]] pxr::SdfPathVector newSources();
    void onChanged(const pxr::SdfNotice::LayersDidChangeSentPerLayer& notice);

    const pxr::PcpLayerStackIdentifier layers_;
    const pxr::SdfLayerRefPtr root_, session_;  // keep the layers in memory
    const StageView view_;
    const std::thread::id thread_ = std::this_thread::get_id();
    std::unique_ptr<stage::Composition> composition_;
    pxr::SdfPathSet uncomposed_;       // prims that are composed again, with all prims below them
    std::atomic<bool> stale_ = false;  // set when another thread changed a layer
    std::atomic<bool> hasInstances_ = false;
    // For each prototype, the instance whose children are composed.
    std::unordered_map<pxr::PcpInstanceKey, pxr::SdfPath, pxr::PcpInstanceKey::Hash> sources_;
    std::unordered_set<pxr::SdfPath, pxr::SdfPath::Hash> opened_;
    pxr::TfNotice::Key changedKey_;
};

}  // namespace usdlive::naming
