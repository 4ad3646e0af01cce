// Declares Stage, the composed prims of a root layer and a session layer, kept up to date with
// them.
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

/// The options of a new Stage.
struct StageOptions {
    LoadRules load = {};
    PopulationMask mask = {};
    std::vector<std::string> muted = {};  ///< identifiers of the layers to leave out
    /// The schemas of the prims. If it is null, the stage uses the schemas of this process's
    /// plug-ins; these are read once and shared by all stages.
    std::shared_ptr<const schema::SchemaRegistry> schemas = {};
};

/// One composition error, for example an arc to a missing prim, a cycle or a missing layer.
struct CompositionError {
    std::string type;   ///< for example "InvalidAssetPath"
    pxr::SdfPath prim;  ///< a path of the stage; the pseudo-root for errors of local layers
    std::string message;
};

/// A tree of prims, composed from a root layer, a session layer and all layers that they include.
///
/// The stage follows its layers. It is updated before the call that edits a layer returns, whether
/// this program or a Client makes the edit. Only the changed parts of the tree are composed again.
///
/// Threads: create the stage, edit its layers and destroy it on one thread. Changes that another
/// thread makes are ignored, and the stage is then out of date. Several threads may read the stage
/// while no thread edits.
///
/// Errors: bad input (cycles, missing layers, invalid paths) is listed by errors(). The rest of the
/// stage stays usable.
///
/// Ownership: the stage keeps its layers in memory. Prim and Property handles become invalid when
/// the stage is destroyed.
class Stage {
public:
    /// Receives the changes of one update.
    using Listener = std::function<void(const StageChanges&)>;
    /// Keeps a listener subscribed. The subscription ends when its last copy is destroyed.
    using Subscription = std::shared_ptr<void>;

    /// Opens the layer of a file and composes a stage over it. Fails with LayerUnreadable if the
    /// layer cannot be opened.
    [[nodiscard]] static Result<std::unique_ptr<Stage>> open(const std::string& rootFile,
                                                             StageOptions options = {});
    /// Composes a stage over open layers. `root` must not be null. If `session` is null, the stage
    /// creates an anonymous session layer.
    explicit Stage(const pxr::SdfLayerRefPtr& root, const pxr::SdfLayerRefPtr& session = {},
                   StageOptions options = {});
    ~Stage();
    Stage(const Stage&) = delete;
    Stage& operator=(const Stage&) = delete;

    [[nodiscard]] pxr::SdfLayerHandle rootLayer() const;
    [[nodiscard]] pxr::SdfLayerHandle sessionLayer() const;
    /// Returns the session layer and its sublayers, then the root layer and its sublayers, from
    /// strong to weak. Muted layers are left out.
    [[nodiscard]] pxr::SdfLayerRefPtrVector localLayers() const;
    [[nodiscard]] bool hasLocalLayer(const pxr::SdfLayerHandle& layer) const;
    /// Returns all layers that contribute to the prims composed now, including layers behind arcs
    /// and the value clips that values were read from.
    [[nodiscard]] pxr::SdfLayerHandleSet usedLayers() const;
    /// Returns the composition of the stage. `layers::StageHost::composition()` returns it to the
    /// client library; its class is private to that library.
    [[nodiscard]] Composition& composition() const;
    [[nodiscard]] const schema::SchemaRegistry& schemas() const;

    [[nodiscard]] Prim pseudoRoot() const;
    /// Returns the prim at a path, or an invalid prim if there is none. For a path inside an
    /// instance, it returns an instance proxy.
    [[nodiscard]] Prim prim(const pxr::SdfPath& path) const;
    /// Returns the property at a path, or an invalid property if no layer or schema has it.
    [[nodiscard]] Property property(const pxr::SdfPath& path) const;
    /// Returns all prims that match, in order, each parent before its children. The pseudo-root is
    /// not included.
    [[nodiscard]] std::vector<Prim> traverse(
        const PrimPredicate& predicate = PrimPredicate::normal()) const;
    /// Calls `visit` for each prim, in the same order. `visit` returns false to skip the prims
    /// below.
    void traverse(const PrimPredicate& predicate,
                  const std::function<bool(const Prim&)>& visit) const;
    /// Returns the default prim of the root layer, or an invalid prim if there is none.
    [[nodiscard]] Prim defaultPrim() const;
    /// Returns the prototypes in the order of their creation.
    [[nodiscard]] std::vector<Prim> prototypes() const;
    /// Returns the instances of a prototype, in the order of their paths.
    [[nodiscard]] std::vector<Prim> instances(const Prim& prototype) const;

    /// Returns one field of the stage's metadata. If no layer has it, returns the field's fallback;
    /// if it is not a field of stages, returns an empty value.
    [[nodiscard]] pxr::VtValue metadata(const pxr::TfToken& field) const;
    /// Returns true if one layer, the root layer or the session layer, has both a start and an end
    /// time code.
    [[nodiscard]] bool hasTimeRange() const;
    /// Returns the start time code, or 0 if there is none.
    [[nodiscard]] double startTime() const;
    /// Returns the end time code, or 0 if there is none.
    [[nodiscard]] double endTime() const;
    /// Returns the composition errors, sorted by prim and type.
    [[nodiscard]] std::vector<CompositionError> errors() const;

    [[nodiscard]] const LoadRules& loadRules() const;
    /// Replaces the load rules and updates the stage before it returns.
    void setLoadRules(const LoadRules& rules);
    /// Sets the load rule of one prim.
    void load(const pxr::SdfPath& prim, LoadRules::Rule rule = LoadRules::Rule::All);
    void unload(const pxr::SdfPath& prim) { load(prim, LoadRules::Rule::None); }
    [[nodiscard]] const PopulationMask& mask() const;
    /// Replaces the population mask and composes the stage again.
    void setMask(const PopulationMask& mask);
    [[nodiscard]] const std::vector<std::string>& mutedLayers() const;
    /// Mutes these layers, and unmutes all others. The root layer cannot be muted.
    void setMutedLayers(const std::vector<std::string>& identifiers);

    [[nodiscard]] const EditTarget& editTarget() const;
    void setEditTarget(const EditTarget& target);
    /// Returns an edit target for a local layer, with the layer's time offset. For another layer
    /// the offset is the identity.
    [[nodiscard]] EditTarget editTargetFor(const pxr::SdfLayerHandle& layer) const;

    /// Calls `listener` after each change, on the thread that edited, when the stage is already
    /// updated. The caller keeps the returned subscription.
    [[nodiscard]] Subscription subscribe(Listener listener);

    /// Returns how often a prim was composed into the tree since the stage was created. A prim that
    /// was composed twice counts twice.
    [[nodiscard]] std::size_t primsUpdated() const;

private:
    const std::unique_ptr<StageState> state_;
};

}  // namespace usdlive::stage
