// Plans one namespace edit with Pcp, and adds the cases that Pcp leaves out.
#include "usd/namespace/Planner.h"

#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/pcp/dependentNamespaceEditUtils.h>
#include <pxr/usd/pcp/layerRelocatesEditBuilder.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>

#include "usd/namespace/VariantSites.h"

namespace usdlive::naming {

using pxr::PcpNodeRef;
using pxr::PcpPrimIndex;
using pxr::SdfLayerHandle;
using pxr::SdfPath;
using Edit = NamespaceEditor::Edit;

namespace {

std::string at(const SdfLayerHandle& layer, const SdfPath& path) {
    return "@" + layer->GetIdentifier() + "@<" + path.GetString() + ">";
}

/// Validates one edit in the order and with the messages of UsdNamespaceEditor, and makes its plan.
class Planner {
public:
    Planner(const Stages& stages, const Edit& edit, const NamespaceEditOptions& options)
        : stages_(stages),
          stage_(*stages.edited),
          edit_(edit),
          options_(options),
          isProperty_(edit.from.IsPropertyPath()) {}

    Plan make() {
        auto error = isProperty_ ? sourcePropertyError() : sourcePrimError();
        if (error.empty() && !edit_.to.IsEmpty()) error = destinationError();
        if (!error.empty()) {
            plan_.errors.push_back(std::move(error));
            return std::move(plan_);
        }
        checkRelocates();
        if (!checkEditTarget()) return std::move(plan_);
        const auto layers = pxr::PcpGatherLayersToEditForSpecMove(stage_.localLayers(), edit_.from,
                                                                  edit_.to, &plan_.errors);
        const auto variants = movesVariants_ ? variantMoves() : std::vector<VariantMove>();
        if (!plan_.errors.empty()) return std::move(plan_);
        gather(edit_.from, edit_.to, layers);
        for (const auto& [layer, move] : variants) plan_.layers[layer].moves.push_back(move);
        noteLocalLayers();
        if (!variants.empty()) noteObject();
        checkPermissions();
        return std::move(plan_);
    }

private:
    [[nodiscard]] std::string sourcePrimError() const {
        const SdfPath& path = edit_.from;
        if (stages_.host->isInPrototype(path))
            return "The prim to edit belongs to a prototype prim";
        if (!stage_.prim(path)) return notValid("The prim to edit", path);
        if (stage_.isInstanceProxy(path))
            return "The prim to edit is a prototype proxy descendant of an instance prim";
        return {};
    }

    [[nodiscard]] std::string notValid(const std::string& what, const SdfPath& path) const {
        const auto why = stage_.whyLeftOut(path);
        return what + " is not a valid prim" + (why.empty() ? std::string() : ": " + why);
    }

    [[nodiscard]] std::string sourcePropertyError() const {
        const SdfPath prim = edit_.from.GetPrimPath();
        const auto& name = edit_.from.GetNameToken();
        if (stages_.host->isInPrototype(prim))
            return "The property to edit belongs to a prototype prim";
        const auto* index = stage_.prim(prim);
        if (!index || !hasProperty(*index, name))
            return "The property to edit is not a valid property";
        if (stage_.isInstanceProxy(prim))
            return "The property to edit belongs to an instance prototype proxy";
        if (isBuiltIn(*index, name))
            return "The property to edit is a built-in property of its prim";
        return {};
    }

    [[nodiscard]] std::string destinationError() const {
        const SdfPath& to = edit_.to;
        if (objectExists(to)) return "An object already exists at the new path";
        const bool isReparent = isProperty_ ? edit_.from.GetPrimPath() != to.GetPrimPath()
                                            : edit_.from.GetParentPath() != to.GetParentPath();
        if (isReparent)
            if (auto error = parentError(to.GetParentPath()); !error.empty()) return error;
        return isProperty_ ? std::string() : prohibitedError();
    }

    [[nodiscard]] std::string parentError(const SdfPath& parent) const {
        if (stages_.host->isInPrototype(parent))
            return "The new parent prim belongs to a prototype prim";
        if (!stage_.prim(parent)) return notValid("The new parent prim", parent);
        if (stage_.isInstanceProxy(parent))
            return "The new parent prim is a prototype proxy descendant of an instance prim";
        if (isProperty_)
            return parent.IsAbsoluteRootPath()
                       ? "The new parent prim for a property cannot be the pseudo-root"
                       : std::string();
        if (stage_.isInstance(parent))
            return "The new parent prim is an instance prim whose children are provided "
                   "exclusively by its prototype";
        if (parent == edit_.from) return "The new parent prim is the same as the prim to move";
        if (parent.HasPrefix(edit_.from))
            return "The new parent prim is a descendant of the prim to move";
        return {};
    }

    // Returns an error if a relocate prohibits the new name. The prim that this relocate moved may
    // return to it.
    [[nodiscard]] std::string prohibitedError() const {
        const auto* parent = stage_.prim(edit_.to.GetParentPath());
        if (!parent) return "The new parent prim is not a valid prim";
        const auto hasRelocates = [](const pxr::PcpNodeRef& node) {
            return node.GetLayerStack()->HasRelocates();
        };
        // Composing the names takes long with many siblings.
        if (std::ranges::none_of(parent->GetNodeRange(), hasRelocates)) return {};
        pxr::TfTokenVector names;
        pxr::PcpTokenSet prohibited;
        parent->ComputePrimChildNames(&names, &prohibited);
        if (!prohibited.count(edit_.to.GetNameToken())) return {};
        const auto& relocates = stage_.localLayers()->GetIncrementalRelocatesSourceToTarget();
        const auto own = relocates.find(edit_.to);
        if (own != relocates.end() && own->second == edit_.from) return {};
        return "The new path is a prohibited child of its parent path because of existing "
               "relocates.";
    }

    [[nodiscard]] bool isBuiltIn(const PcpPrimIndex& prim, const pxr::TfToken& name) const {
        return stages_.host->isBuiltIn(ComposedStage::typeName(prim),
                                       ComposedStage::apiSchemas(prim), name);
    }
    [[nodiscard]] bool hasProperty(const PcpPrimIndex& prim, const pxr::TfToken& name) const {
        return ComposedStage::hasAuthoredProperty(prim, name) || isBuiltIn(prim, name);
    }
    [[nodiscard]] bool objectExists(const SdfPath& path) const {
        const SdfPath prim = path.GetPrimPath();
        const auto* index = stage_.prim(prim);
        if (!index) return stages_.host->isInPrototype(prim) && !isProperty_;
        return !isProperty_ || hasProperty(*index, path.GetNameToken());
    }

    // Returns true if only variants of the local layers lead from the prim's own node to `node`.
    [[nodiscard]] static bool isLocalVariant(const PcpNodeRef& node) {
        for (auto up = node; up.GetArcType() != pxr::PcpArcTypeRoot; up = up.GetParentNode())
            if (up.GetArcType() != pxr::PcpArcTypeVariant) return false;
        return true;
    }

    // Looks for opinions that stay at the old path whatever changes in the local layers. A direct
    // arc moves with the prim; an arc of an ancestor does not.
    void checkRelocates() {
        const auto* prim = stage_.prim(edit_.from.GetPrimPath());
        bool needed =
            !isProperty_ &&
            stage_.localLayers()->GetIncrementalRelocatesTargetToSource().contains(edit_.from);
        bool inVariants = false;
        const auto consider = [&](const PcpNodeRef& node) {
            if (!node.HasSpecs() || node.IsInert() ||
                (isProperty_ && !hasPropertySpec(node, edit_.from.GetNameToken())))
                return;
            if (options_.editVariants && isLocalVariant(node))
                inVariants = true;
            else
                needed = true;
        };
        for (const auto& child : prim->GetRootNode().GetChildrenRange()) {
            if (!isProperty_ && !child.IsDueToAncestor()) continue;
            for (const auto& node : prim->GetNodeSubtreeRange(child)) consider(node);
        }
        movesVariants_ = options_.editVariants && !needed;
        if (!needed) return;
        if (isProperty_)
            plan_.errors.emplace_back(
                "The property to edit requires authoring relocates since it composes opinions "
                "introduced by ancestral composition arcs; authoring relocates is not supported "
                "for properties");
        else if (!options_.allowRelocatesAuthoring)
            plan_.errors.emplace_back(
                "The prim to edit requires authoring relocates since it composes opinions "
                "introduced by ancestral composition arcs; relocates authoring must be enabled to "
                "perform this edit");
        else if (const auto outside = movedOutAbove(edit_.to); !outside.IsEmpty())
            plan_.errors.push_back("The prim to edit cannot be moved below <" +
                                   outside.GetString() + ">, which a relocate has moved out of it");
        else if (const auto hidden = hiddenAbove(edit_.to); !hidden.IsEmpty())
            plan_.errors.push_back("The prim to edit cannot be moved below <" + hidden.GetString() +
                                   ">, which the relocate of the edit would remove");
        else
            plan_.hasRelocates = true;
    }

    // If `path` is at or below the target of a relocate out of this prim, returns that target. Two
    // relocates whose sources are below each other's targets compose to nothing.
    [[nodiscard]] SdfPath movedOutAbove(const SdfPath& path) {
        for (const auto& [source, target] :
             stage_.localLayers()->GetIncrementalRelocatesSourceToTarget())
            if (!target.IsEmpty() && source.HasPrefix(edit_.from) && path.HasPrefix(target))
                return target;
        return {};
    }

    // A relocate also removes its source from all prims that an arc gives the children of the
    // source's parent. If `path` is below such a prim, returns it.
    [[nodiscard]] SdfPath hiddenAbove(const SdfPath& path) const {
        const auto layers = stage_.localLayers();
        for (SdfPath at = path.GetParentPath(); at.IsPrimPath(); at = at.GetParentPath()) {
            const auto* parent = stage_.prim(at.GetParentPath());
            if (at.GetNameToken() != edit_.from.GetNameToken() || !parent) continue;
            for (const auto& node : parent->GetNodeRange())
                if (node.GetPath() == edit_.from.GetParentPath() && node.GetLayerStack() == layers)
                    return at;
        }
        return {};
    }

    [[nodiscard]] static bool hasPropertySpec(const PcpNodeRef& node, const pxr::TfToken& name) {
        const SdfPath path = node.GetPath().AppendProperty(name);
        return !path.IsEmpty() &&
               std::ranges::any_of(node.GetLayerStack()->GetLayers(),
                                   [&](const auto& layer) { return layer->HasSpec(path); });
    }

    bool checkEditTarget() {
        if (stages_.targetMapsPaths && !options_.editVariants) {
            plan_.errors.emplace_back(
                "Edit targets that map paths across composition arcs are not currently supported "
                "for namespace editing");
            return false;
        }
        const auto& layers = stage_.localLayers()->GetLayers();
        const bool isLocal =
            !stages_.editTarget || std::ranges::any_of(layers, [&](const auto& layer) {
                return SdfLayerHandle(layer) == stages_.editTarget;
            });
        if (!isLocal)
            plan_.errors.emplace_back(
                "Edit targets with layers outside of the root layer stack are not currently "
                "supported for namespace editing");
        return isLocal;
    }

    // Returns the same edit for each variant of the local layers that contains opinions.
    [[nodiscard]] std::vector<VariantMove> variantMoves() {
        std::vector<VariantMove> moves;
        for (const auto& layer : stage_.localLayers()->GetLayers())
            for (const SdfPath& site : variantSites(layer, edit_.from)) {
                const SdfPath to = withinVariant(site, edit_.to);
                if (!edit_.to.IsEmpty() && to.IsEmpty())
                    plan_.errors.push_back("The spec " + at(layer, site) + " cannot be moved to <" +
                                           edit_.to.GetString() +
                                           "> because that is outside of its variant");
                else if (!to.IsEmpty() && layer->HasSpec(to))
                    plan_.errors.push_back("The spec " + at(layer, site) + " cannot be moved to <" +
                                           to.GetString() +
                                           "> because a spec already exists at the new path");
                else
                    moves.push_back({layer, {site, to}});
            }
        return moves;
    }

    void gather(const SdfPath& from, const SdfPath& to, const pxr::SdfLayerHandleVector& layers) {
        std::vector<const pxr::PcpCache*> caches{&stage_.composed()};
        for (auto* dependent : stages_.dependents) caches.push_back(&dependent->composed());
        pxr::TfErrorMark mark;
        const auto stack = plan_.hasRelocates ? stage_.localLayers() : pxr::PcpLayerStackRefPtr();
        const auto edits = pxr::PcpGatherDependentNamespaceEdits(from, to, layers, stack,
                                                                 stages_.editTarget, caches);
        // If arcs form cycles, Pcp may not find all prims that depend on the edit.
        if (!mark.IsClean())
            plan_.errors.push_back("What depends on <" + from.GetString() +
                                   "> cannot be found: " + mark.begin()->GetCommentary());
        mark.Clear();
        plan_.warnings.insert(plan_.warnings.end(), edits.warnings.begin(), edits.warnings.end());
        if (!isProperty_)
            for (const auto& arc : edits.compositionFieldEdits)
                plan_.layers[arc.layer].arcs.push_back(
                    {arc.path, arc.fieldName, arc.newFieldValue});
        for (const auto& [layer, moves] : edits.layerSpecMoves)
            for (const auto& [oldPath, newPath] : moves)
                plan_.layers[layer].moves.push_back({oldPath, newPath});
        keepParentsOfMoved();
        if (!isProperty_) noteRelocates(edits);
        for (const auto* cache : caches) {
            auto& objects = plan_.objects.emplace_back();
            auto& reported = plan_.reportedDeleted.emplace_back();
            const auto changes = edits.dependentCachePathChanges.find(cache);
            if (changes == edits.dependentCachePathChanges.end()) continue;
            for (const auto& [oldPath, newPath] : changes->second) {
                if (oldPath == newPath) continue;
                const bool isEdit = cache == caches.front() && oldPath == from;
                if (newPath.IsEmpty() && !isEdit)
                    reported.push_back(oldPath);
                else
                    objects.push_back({oldPath, newPath});
            }
        }
        if (!isProperty_) followRelocates();
    }

    // Pcp deletes the specs over a prim that an arc no longer brings. They stay if the edited prim,
    // or one that depends on it, moves below them. It would be deleted with them otherwise.
    void keepParentsOfMoved() {
        for (auto& [layer, changes] : plan_.layers) {
            pxr::SdfPathVector targets{edit_.to};
            for (const auto& move : changes.moves) targets.push_back(move.to);
            std::erase_if(changes.moves, [&](const PathMove& move) {
                return move.to.IsEmpty() && std::ranges::any_of(targets, [&](const SdfPath& to) {
                           return to != move.from && to.HasPrefix(move.from);
                       });
            });
        }
    }

    // Pcp leaves out relocates to a path below a prim that moves, if it does not compose their
    // sources with it.
    void followRelocates() {
        for (std::size_t i = 0; i < plan_.objects.size(); ++i) {
            auto& stage = i == 0 ? stage_ : *stages_.dependents[i - 1];
            const bool movesSources = i > 0 || !plan_.hasRelocates;
            const PathMap moves(plan_.objects[i]);
            for (const auto& layer : stage.localLayers()->GetLayers())
                if (layer->HasRelocates()) followRelocates(layer, moves, movesSources);
        }
    }

    void followRelocates(const SdfLayerHandle& layer, const PathMap& moves, bool movesSources) {
        const auto present = layer->GetRelocates();
        const auto changes = plan_.layers.find(layer);
        const auto planned =
            changes == plan_.layers.end() ? std::nullopt : changes->second.relocates;
        auto relocates = planned.value_or(present);
        for (auto& relocate : relocates) {
            if (std::ranges::find(present, relocate) == present.end()) continue;  // Pcp changed it
            auto& [source, target] = relocate;
            if (movesSources) source = followed(source, moves);
            target = followed(target, moves);
        }
        if (relocates != planned.value_or(present)) plan_.layers[layer].relocates = relocates;
    }

    // A path that is deleted stays.
    [[nodiscard]] static SdfPath followed(const SdfPath& path, const PathMap& moves) {
        const auto moved = moves.after(path);
        return moved.IsEmpty() ? path : moved;
    }

    void noteRelocates(const pxr::PcpDependentNamespaceEdits& edits) {
        for (const auto& [layer, relocates] : edits.dependentRelocatesEdits)
            plan_.layers[layer].relocates = relocates;
        if (!plan_.hasRelocates) return;
        pxr::PcpLayerRelocatesEditBuilder builder(stage_.localLayers(), stages_.editTarget);
        std::string reason;
        if (!builder.Relocate(edit_.from, edit_.to, &reason)) {
            plan_.errors.push_back("The relocates cannot be edited: " + reason);
            return;
        }
        for (const auto& [layer, relocates] : builder.GetEdits()) addNewRelocate(layer, relocates);
    }

    // Pcp drops the new relocate if other relocates exist below its source. The relocates builder
    // keeps it.
    void addNewRelocate(const SdfLayerHandle& layer, const pxr::SdfRelocates& wanted) {
        const auto present = layer->GetRelocates();
        auto& planned = plan_.layers[layer].relocates;
        if (!planned) planned = present;
        const auto isIn = [](const pxr::SdfRelocates& relocates, const pxr::SdfRelocate& one) {
            return std::ranges::find(relocates, one) != relocates.end();
        };
        for (const auto& relocate : wanted)
            if (relocate.second == edit_.to && !isIn(present, relocate) &&
                !isIn(*planned, relocate))
                planned->push_back(relocate);
    }

    void noteLocalLayers() {
        const auto note = [&](ComposedStage& stage) {
            auto& layers = plan_.localLayers.emplace_back();
            for (const auto& layer : stage.localLayers()->GetLayers()) layers.push_back(layer);
        };
        note(stage_);
        for (auto* dependent : stages_.dependents) note(*dependent);
    }

    // Pcp does not report moves inside variants.
    void noteObject() {
        const PathMove object{edit_.from, edit_.to};
        if (std::ranges::find(plan_.objects.front(), object) == plan_.objects.front().end())
            plan_.objects.front().push_back(object);
    }

    // Checks the layers that the plan changes. Pcp has checked those of the edit itself.
    void checkPermissions() {
        for (const auto& [layer, changes] : plan_.layers) {
            if (layer->PermissionToEdit()) continue;
            std::string what;
            if (!changes.moves.empty())
                what = "The spec " + at(layer, changes.moves.front().from);
            else if (!changes.arcs.empty())
                what = "The field " + changes.arcs.front().field.GetString() + " of " +
                       at(layer, changes.arcs.front().path);
            else
                what = "The field relocates of " + at(layer, SdfPath::AbsoluteRootPath());
            plan_.errors.push_back(what + " cannot be edited because the layer is not editable");
        }
    }

    const Stages& stages_;
    ComposedStage& stage_;
    const Edit& edit_;
    const NamespaceEditOptions& options_;
    const bool isProperty_;
    bool movesVariants_ = false;
    Plan plan_;
};

}  // namespace

bool Plan::concernsMore() const {
    return hasRelocates ||
           std::ranges::any_of(reportedDeleted, [](const auto& paths) { return !paths.empty(); }) ||
           std::ranges::any_of(
               layers, [](const auto& layer) { return layer.second.relocates.has_value(); });
}

std::vector<PathMoves> Plan::touched() const {
    auto all = objects;
    for (const auto& [layer, changes] : layers) {
        all.push_back(changes.moves);
        auto& arcs = all.emplace_back();
        for (const auto& arc : changes.arcs) arcs.push_back({arc.path, SdfPath()});
    }
    return all;
}

std::vector<Step> inSteps(const std::vector<Plan>& plans) {
    MoveSteps steps;
    std::vector<Step> made(1);
    for (std::size_t plan = 0; plan < plans.size(); ++plan) {
        std::vector<const PathMoves*> layers;
        for (const auto& [layer, changes] : plans[plan].layers) layers.push_back(&changes.moves);
        const auto numbers = steps.add(layers);
        made.resize(std::max(made.size(), steps.count()));
        std::size_t index = 0;
        for (const auto& [layer, changes] : plans[plan].layers) {
            for (std::size_t i = 0; i < changes.moves.size(); ++i) {
                Step& step = made[numbers[index][i]];
                if (step.empty() || step.back().plan != plan) step.push_back({plan, {}});
                step.back().moves[layer].push_back(changes.moves[i]);
            }
            ++index;
        }
    }
    return made;
}

Plan planEdit(const Stages& stages, const Edit& edit, const NamespaceEditOptions& options) {
    return Planner(stages, edit, options).make();
}

}  // namespace usdlive::naming
