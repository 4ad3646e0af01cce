#pragma once

#include <pxr/usd/pcp/errors.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "usdlive/client/usd/stage/EditTarget.h"
#include "usdlive/client/usd/stage/LoadRules.h"
#include "usdlive/client/usd/stage/PopulationMask.h"
#include "usdlive/client/usd/stage/Prim.h"
#include "usdlive/client/usd/stage/Property.h"
#include "usdlive/client/usd/stage/StageChanges.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::schema {
class SchemaRegistry;
}

namespace usdlive::stage {

class Composition;
class StageState;

/// How a stage is opened.
struct StageOptions {
    LoadRules load = {};
    PopulationMask mask = {};
    std::vector<std::string> muted = {};  ///< identifiers of layers
    /// Schemas of the prims. Null: of the plug-ins of this process, read once for all stages.
    std::shared_ptr<const schema::SchemaRegistry> schemas = {};
};

/// One problem of composition: an arc to nothing, a cycle, a layer that is not there.
struct CompositionError {
    std::string type;   ///< "InvalidAssetPath"
    pxr::SdfPath prim;  ///< of the stage; the pseudo-root's for problems of local layers
    std::string message;
};

/// A root layer and a session layer with all that they include, composed: a tree of prims.
///
/// It follows its layers: an edit of any of them, by this program or by a Client within its tick,
/// updates the tree before the call that makes it returns, where it changed and nowhere else. What
/// answers questions of prims is never older than the layers.
///
/// One thread, the one that created it; its layers are edited on this thread too. Several threads
/// may read while nobody edits. Bad input (cycles, layers that are missing, invalid paths) becomes
/// errors(); the rest of the stage is as usable as ever.
class Stage {
public:
    using Listener = std::function<void(const StageChanges&)>;
    /// Ends the subscription when the last copy goes.
    using Subscription = std::shared_ptr<void>;

    /// The layer of a file. An error: it cannot be opened.
    [[nodiscard]] static Result<std::unique_ptr<Stage>> open(const std::string& rootFile,
                                                             StageOptions options = {});
    /// Without a session layer it gets an anonymous one.
    explicit Stage(const pxr::SdfLayerRefPtr& root, const pxr::SdfLayerRefPtr& session = {},
                   StageOptions options = {});
    ~Stage();
    Stage(const Stage&) = delete;
    Stage& operator=(const Stage&) = delete;

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const;
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const;
    /// Strong to weak, those of the session first.
    [[nodiscard]] pxr::SdfLayerRefPtrVector localLayers() const;
    [[nodiscard]] bool hasLocalLayer(const pxr::SdfLayerHandle& layer) const;
    [[nodiscard]] pxr::SdfLayerHandleSet usedLayers() const;
    /// The composition below, which `layers::StageHost` returns from composition(). Its class is
    /// private to the client library.
    [[nodiscard]] Composition& composition() const;
    [[nodiscard]] const schema::SchemaRegistry& schemas() const;

    [[nodiscard]] Prim pseudoRoot() const;
    /// Invalid: no prim is there. A path inside an instance gives an instance proxy.
    [[nodiscard]] Prim prim(const pxr::SdfPath& path) const;
    [[nodiscard]] Property property(const pxr::SdfPath& path) const;
    /// Parents before children, in order; without the pseudo-root.
    [[nodiscard]] std::vector<Prim> traverse(
        const PrimPredicate& predicate = PrimPredicate::normal()) const;
    /// Calls `visit` for each, in the same order. It returns whether to go on below the prim.
    void traverse(const PrimPredicate& predicate,
                  const std::function<bool(const Prim&)>& visit) const;
    [[nodiscard]] Prim defaultPrim() const;
    /// In the order of their creation.
    [[nodiscard]] std::vector<Prim> prototypes() const;
    /// Instances of a prototype, in the order of their paths.
    [[nodiscard]] std::vector<Prim> instances(const Prim& prototype) const;

    /// Metadata of the stage. Without an opinion, the fallback of the field.
    [[nodiscard]] pxr::VtValue metadata(const pxr::TfToken& field) const;
    /// Whether a range of time codes is authored, and its ends.
    [[nodiscard]] bool hasTimeRange() const;
    [[nodiscard]] double startTime() const;
    [[nodiscard]] double endTime() const;
    [[nodiscard]] std::vector<CompositionError> errors() const;

    [[nodiscard]] const LoadRules& loadRules() const;
    void setLoadRules(const LoadRules& rules);
    void load(const pxr::SdfPath& prim, LoadRules::Rule rule = LoadRules::Rule::All);
    void unload(const pxr::SdfPath& prim) { load(prim, LoadRules::Rule::None); }
    [[nodiscard]] const PopulationMask& mask() const;
    void setMask(const PopulationMask& mask);
    [[nodiscard]] const std::vector<std::string>& mutedLayers() const;
    /// Leaves out these layers and no others. The root layer cannot be left out.
    void setMutedLayers(const std::vector<std::string>& identifiers);

    [[nodiscard]] const EditTarget& editTarget() const;
    void setEditTarget(const EditTarget& target);
    /// A target in a local layer, in the times that the layer counts.
    [[nodiscard]] EditTarget editTargetFor(const pxr::SdfLayerHandle& layer) const;

    /// Called after each change, with the tree already updated.
    [[nodiscard]] Subscription subscribe(Listener listener);

    /// How many prims were composed into the tree until now, each as often as it was.
    [[nodiscard]] std::size_t primsUpdated() const;

private:
    const std::unique_ptr<StageState> state_;
};

}  // namespace usdlive::stage
