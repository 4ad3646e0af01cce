// Collects the changes of a batch for each layer and applies them in one change block.
#include "Application.h"

#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <optional>
#include <set>
#include <unordered_set>

#include "RecordContent.h"
#include "SpecMoves.h"

namespace usdlive::naming {

using pxr::SdfLayerHandle;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

// Returns the paths before the first `count` edits of the objects now at or below `path`. May
// return more paths than exist.
std::set<SdfPath> pathsBefore(const std::vector<PathMoves>& edits, std::size_t count,
                              const SdfPath& path) {
    std::set<SdfPath> paths{path};
    for (std::size_t i = count; i-- > 0;) {
        std::set<SdfPath> earlier;
        for (const SdfPath& one : paths)
            for (const auto& [from, to] : edits[i]) {
                if (to.IsEmpty()) continue;
                if (one.HasPrefix(to))
                    earlier.insert(one.ReplacePrefix(to, from));
                else if (to.HasPrefix(one))
                    earlier.insert(from);
            }
        paths.merge(earlier);
    }
    return paths;
}

}  // namespace

Application::Application(const std::vector<Plan>& plans, PathIndex& index) {
    collectPlan(plans);
    collectPathFields(plans, index);
    std::erase_if(layers_, [](const auto& layer) {
        return layer.second.moves.empty() && layer.second.fields.empty();
    });
    checkPermissions();
}

// Collects arcs and relocates with the last value of each field. A plan names specs by their paths
// at the time of its edit.
void Application::collectPlan(const std::vector<Plan>& plans) {
    for (const auto& plan : plans)
        for (const auto& [layer, changes] : plan.layers) {
            auto& edits = layers_[layer];
            auto& fields = planned_[layer];
            for (const auto& arc : changes.arcs)
                fields[{pathBefore(edits.moves, arc.path), arc.field}] = arc.value;
            if (changes.relocates)
                fields[{SdfPath::AbsoluteRootPath(), pxr::SdfFieldKeys->LayerRelocates}] =
                    VtValue(*changes.relocates);
            edits.moves.insert(edits.moves.end(), changes.moves.begin(), changes.moves.end());
        }
    for (const auto& [layer, fields] : planned_) {
        auto& edits = layers_[layer];
        for (const auto& [key, value] : fields) {
            const auto& [path, field] = key;
            const SdfPath moved = followed(edits.moves, path);
            const auto present = layer->GetField(path, field);
            if (!path.IsEmpty() && !moved.IsEmpty() && present != value)
                edits.fields.push_back({path, moved, field, present, value});
        }
    }
}

void Application::collectPathFields(const std::vector<Plan>& plans, PathIndex& index) {
    std::map<SdfLayerRefPtr, std::vector<PathMoves>> objects;
    for (std::size_t edit = 0; edit < plans.size(); ++edit)
        for (std::size_t stage = 0; stage < plans[edit].objects.size(); ++stage)
            for (const auto& layer : plans[edit].localLayers[stage]) {
                auto& moves = objects[layer];
                moves.resize(plans.size());
                for (const auto& move : plans[edit].objects[stage]) moves[edit].push_back(move);
            }
    for (const auto& [layer, moves] : objects) findPathFields(layer, moves, index);
}

// Pcp plans the arcs that it composes. Others are below inactive prims or in variants that are not
// selected.
void Application::findPathFields(const SdfLayerRefPtr& layer, const std::vector<PathMoves>& objects,
                                 PathIndex& index) {
    pxr::SdfPathVector specs;
    for (std::size_t i = 0; i < objects.size(); ++i)
        for (const auto& move : objects[i])
            for (const SdfPath& path : pathsBefore(objects, i, move.from))
                index.of(layer).specsWithPathsTo(path, specs);
    const auto edits = layers_.find(layer);
    const PathMoves specMoves = edits == layers_.end() ? PathMoves() : edits->second.moves;
    const Planned& planned = planned_[layer];
    std::unordered_set<SdfPath, SdfPath::Hash> seen;
    for (const SdfPath& spec : specs) {
        if (!seen.insert(spec).second) continue;
        const SdfPath moved = followed(specMoves, spec);
        if (moved.IsEmpty() || !layer->HasSpec(spec)) continue;
        const SdfPath owner = moved.StripAllVariantSelections();
        visitPathFields(layer, spec, [&](const TfToken& field, const VtValue& present) {
            const bool isArc = isArcField(field);
            if (isArc && planned.contains({spec, field})) return;
            VtValue value = present;
            for (const auto& moves : objects)
                if (auto next = isArc ? movedArcs(value, moves, owner) : movedValue(value, moves);
                    !next.IsEmpty())
                    value = std::move(next);
            if (value != present)
                layers_[layer].fields.push_back({spec, moved, field, present, value});
        });
    }
}

void Application::checkPermissions() {
    for (const auto& [layer, edits] : layers_) {
        if (layer->PermissionToEdit()) continue;
        const bool isField = !edits.fields.empty();
        const SdfPath& path = isField ? edits.fields.front().before : edits.moves.front().from;
        const std::string where = "@" + layer->GetIdentifier() + "@<" + path.GetString() + ">";
        errors_.push_back((isField ? "The field " + edits.fields.front().field.GetString() + " of "
                                   : "The spec ") +
                          where + " cannot be edited because the layer is not editable");
    }
}

pxr::SdfLayerHandleVector Application::layers() const {
    pxr::SdfLayerHandleVector layers;
    for (const auto& [layer, edits] : layers_) layers.push_back(layer);
    return layers;
}

Result<NamespaceRecord> Application::apply() const {
    const auto content = std::make_shared<NamespaceRecord::Content>(layers_);
    const pxr::SdfChangeBlock block;
    pxr::TfErrorMark mark;
    std::string refused;
    for (const auto& [layer, edits] : layers_) {
        if (!moveSpecs(layer, edits.moves))
            refused = "@" + layer->GetIdentifier() + "@ refuses to move its specs";
        for (const auto& edit : edits.fields)
            if (layer->HasSpec(edit.path)) layer->SetField(edit.path, edit.field, edit.value);
        if (!refused.empty() || !mark.IsClean()) break;
    }
    content->finish();
    if (refused.empty() && mark.IsClean()) return NamespaceRecord(content);
    if (!mark.IsClean()) refused += (refused.empty() ? "" : ": ") + mark.begin()->GetCommentary();
    (void)NamespaceRecord(content).undo([](const SdfLayerHandle&) { return false; });
    mark.Clear();
    return fail(ErrorCode::InvalidEdit, refused);
}

}  // namespace usdlive::naming
