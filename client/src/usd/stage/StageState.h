// Declares StageState, the parts of a stage: composition, prim tree and prototypes, and the
// functions that update them.
#pragma once

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/notice.h>

#include <functional>
#include <mutex>
#include <set>
#include <thread>
#include <unordered_map>
#include <vector>

#include "usd/stage/Clips.h"
#include "usd/stage/Composition.h"
#include "usd/stage/Kinds.h"
#include "usd/stage/PrimNode.h"
#include "usd/stage/Prototypes.h"
#include "usdlive/client/usd/stage/Stage.h"

namespace usdlive::stage {

class StageState final : public pxr::TfWeakBase {
public:
    /// The depth at which composition stops, because arcs may lead deeper without end. errors()
    /// reports it.
    static constexpr std::size_t kDeepest = kDeepestPath;

    StageState(Stage& owner, pxr::SdfLayerRefPtr root, pxr::SdfLayerRefPtr session,
               StageOptions options);
    ~StageState();

    /// Returns the node of a prim of the stage or of a prototype. Returns null if there is none,
    /// and for instance proxies.
    [[nodiscard]] PrimNode* find(const pxr::SdfPath& path) const;
    [[nodiscard]] Prim prim(const pxr::SdfPath& path) const;
    /// Returns null if the session layer is muted.
    [[nodiscard]] pxr::SdfLayerHandle unmutedSession() const;

    void setLoadRules(const LoadRules& rules);
    void setMask(const PopulationMask& mask);
    void setMuted(const std::vector<std::string>& muted);
    [[nodiscard]] Stage::Subscription subscribe(Stage::Listener listener);

    Stage& stage;
    const pxr::SdfLayerRefPtr rootLayer, sessionLayer;
    const std::shared_ptr<const schema::SchemaRegistry> schemas;
    const Kinds kinds;
    LoadRules load;
    PopulationMask mask;
    std::vector<std::string> muted;
    EditTarget target;
    Prototypes prototypes;
    Composition composition;
    const std::shared_ptr<ClipLayers> clipLayers = std::make_shared<ClipLayers>();
    PrimNodePtr root;
    std::size_t primsUpdated = 0;

private:
    using Paths = std::set<pxr::SdfPath>;

    // Composing (StageState.cpp)
    bool composesChildren(const pxr::PcpPrimIndex& index, pxr::TfTokenVector* names);
    void composeIndexes(pxr::SdfPathVector roots, std::set<Prototype*>& changed);
    void composeType(PrimNode& node);
    void composeFlags(PrimNode& node);
    void composeClipSets(PrimNode& node);
    void compose(PrimNode& node);
    void composeChildren(PrimNode& node, const Paths* only);
    void composePrototype(Prototype& prototype);
    [[nodiscard]] pxr::TfTokenVector childNames(const PrimNode& node) const;
    void removeLater(PrimNodePtr node);
    void detach(PrimNode& node);
    void enter(PrimNode& node);
    void readFallbackTypes();
    void noteUnmoved(const pxr::PcpPrimIndex& index);

    // Following changes (StageUpdates.cpp)
    struct Gathered;
    struct Exchanged;
    void onLayersChanged(const pxr::SdfNotice::LayersDidChange& notice);
    void gather(const pxr::PcpLayerStackPtrVector& stacks, const pxr::SdfLayerHandle& layer,
                const pxr::SdfChangeList& changes, Gathered& into) const;
    void gather(const pxr::PcpLayerStackPtrVector& stacks, const pxr::SdfLayerHandle& layer,
                const pxr::SdfPath& path, const pxr::SdfChangeList::Entry& entry,
                Gathered& into) const;
    void gatherSession(Gathered& into) const;
    void gatherClip(ClipSet& set, const pxr::SdfLayerHandle& layer,
                    const pxr::SdfChangeList& changes, Gathered& into) const;
    [[nodiscard]] std::vector<Exchanged> gatherLeaving(const pxr::PcpChanges& changes,
                                                       Gathered& into) const;
    void gatherComing(const std::vector<Exchanged>& exchanged, Gathered& into);
    void follow(pxr::PcpChanges& changes, Gathered& gathered);
    template <class Add>
    void forAffected(const pxr::PcpLayerStackPtrVector& stacks, const pxr::SdfPath& path,
                     Gathered& into, Add&& add) const;
    template <class Add>
    void forUnmoved(const pxr::PcpLayerStackPtr& stack, const pxr::SdfPath& path, Gathered& into,
                    Add&& add) const;
    void composeUnmoved(const Gathered& gathered, pxr::PcpChanges& changes) const;
    bool hasArcsOf(Prototype& prototype, const pxr::PcpPrimIndex& index);
    void becomeInstances(const pxr::SdfPathSet& withOtherSpecs, Paths& recompose);
    void recompose(Paths& resynced);
    [[nodiscard]] bool isComposed(const pxr::SdfPath& path) const;
    [[nodiscard]] PrimNode* shownBy(const pxr::SdfPath& index) const;
    void reorder(Gathered& gathered);
    void moveToPrototypes(Gathered& gathered) const;
    void notify(const StageChanges& changes);

    const std::thread::id thread_ = std::this_thread::get_id();
    std::unordered_map<pxr::SdfPath, PrimNode*, pxr::SdfPath::Hash> nodes_;
    std::mutex removedMutex_;  // guards removed_ and unmoved_ while prims are composed
    std::vector<PrimNodePtr> removed_;
    // Prims at the sources of relocates that are shown nevertheless, because a prim that they
    // specialize has opinions on them. A path stays here when its prim is removed.
    Paths unmoved_;
    pxr::VtDictionary fallbackTypes_;
    std::vector<std::weak_ptr<Stage::Listener>> listeners_;
    pxr::TfNotice::Key changedKey_;
};

}  // namespace usdlive::stage
