// Collects the changes of a batch for each layer and applies them step by step.
#include "usd/namespace/Application.h"

#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <optional>
#include <ranges>
#include <set>
#include <tuple>
#include <unordered_set>

#include "usd/namespace/RecordContent.h"
#include "usd/namespace/SpecMoves.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::naming {

using pxr::SdfLayerHandle;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

// Returns the paths before all steps of the objects that are at or below `path` after the first
// `count` steps. May return more paths than exist.
pxr::SdfPathSet pathsBefore(const std::vector<PathMap>& steps, std::size_t count,
                            const SdfPath& path) {
    pxr::SdfPathSet paths{path};
    for (std::size_t i = count; i-- > 0;) {
        pxr::SdfPathSet earlier;
        for (const SdfPath& one : paths) steps[i].addBefore(one, earlier);
        paths.merge(earlier);
    }
    return paths;
}

// Calls `visit` with each move of the objects of a plan in each layer of their stages, once.
template <class Visit>
void forEachPlace(const Changes::Objects& plan, const Visit& visit) {
    std::set<std::tuple<SdfLayerHandle, SdfPath, SdfPath>> visited;
    for (std::size_t stage = 0; stage < plan.moves.size(); ++stage)
        for (const auto& layer : plan.localLayers[stage])
            for (const auto& [from, to] : plan.moves[stage])
                if (layer->PermissionToEdit() && visited.emplace(layer, from, to).second)
                    visit(layer, from, to);
}

}  // namespace

std::vector<SdfLayerRefPtr> Changes::layers() const {
    std::set<SdfLayerRefPtr> layers;
    for (const auto& step : steps)
        for (const auto& edit : step)
            for (const auto& [layer, moves] : edit.moves) layers.insert(layer);
    for (const auto& [layer, edits] : fields)
        if (!edits.empty()) layers.insert(layer);
    return {layers.begin(), layers.end()};
}

void Changes::notePlaces(std::size_t step) const {
    for (const auto& plan : objects)
        if (plan.madeWith == step) forEachPlace(plan, usd::SdfLayerStore::placeMoved);
}

void Changes::notePlacesBack(std::size_t step,
                             const std::function<bool(std::size_t)>& isUndone) const {
    const auto moveBack = [](const SdfLayerHandle& layer, const SdfPath& from, const SdfPath& to) {
        if (!to.IsEmpty()) usd::SdfLayerStore::placeMoved(layer, to, from);
    };
    for (std::size_t number = objects.size(); number-- > 0;)
        if (objects[number].madeWith == step && isUndone(number))
            forEachPlace(objects[number], moveBack);
}

Application::Application(const std::vector<Plan>& plans, PathIndex& index) {
    changes_.steps = inSteps(plans);
    collectPlanned(plans);
    collectPathFields(plans, index);
    for (std::size_t step = 0; step < changes_.steps.size(); ++step)
        for (const auto& edit : changes_.steps[step]) changes_.objects[edit.plan].madeWith = step;
    checkPermissions();
}

SdfPath Application::after(const SdfLayerHandle& layer, SdfPath path) const {
    if (const auto steps = specMoves_.find(layer); steps != specMoves_.end())
        for (const auto& step : steps->second) path = path.IsEmpty() ? path : step.after(path);
    return path;
}

// Collects arcs and relocates with the last value of each field. A plan names specs by their paths
// at the time of its edit.
void Application::collectPlanned(const std::vector<Plan>& plans) {
    std::vector<std::vector<std::pair<std::size_t, const StepEdit*>>> movesOf(plans.size());
    for (std::size_t step = 0; step < changes_.steps.size(); ++step)
        for (const auto& edit : changes_.steps[step]) movesOf[edit.plan].emplace_back(step, &edit);
    for (std::size_t i = 0; i < plans.size(); ++i) {
        for (const auto& [layer, changes] : plans[i].layers) {
            auto& fields = planned_[layer];
            for (const auto& arc : changes.arcs) {
                SdfPath path = arc.path;
                if (const auto steps = specMoves_.find(layer); steps != specMoves_.end())
                    for (const auto& step : std::views::reverse(steps->second))
                        path = path.IsEmpty() ? path : step.before(path);
                fields[{path, arc.field}] = arc.value;
            }
            if (changes.relocates)
                fields[{SdfPath::AbsoluteRootPath(), pxr::SdfFieldKeys->LayerRelocates}] =
                    VtValue(*changes.relocates);
        }
        for (const auto& [step, edit] : movesOf[i])
            for (const auto& [layer, moves] : edit->moves) {
                auto& maps = specMoves_[layer];
                maps.resize(changes_.steps.size());
                for (const auto& move : moves) maps[step].add(move);
            }
    }
    for (const auto& [layer, fields] : planned_)
        for (const auto& [key, value] : fields) {
            const auto& [path, field] = key;
            if (path.IsEmpty()) continue;
            const SdfPath moved = after(layer, path);
            const auto present = layer->GetField(path, field);
            if (!moved.IsEmpty() && present != value)
                changes_.fields[layer].push_back({path, moved, field, present, value});
        }
}

void Application::collectPathFields(const std::vector<Plan>& plans, PathIndex& index) {
    MoveSteps steps;
    std::map<SdfLayerRefPtr, std::vector<PathMoves>> objects;
    for (const Plan& plan : plans) {
        const std::size_t step = steps.addAtOnce(plan.objects);
        changes_.objects.push_back({plan.objects, plan.localLayers, plan.hasRelocates, step});
        for (std::size_t stage = 0; stage < plan.objects.size(); ++stage)
            for (const auto& layer : plan.localLayers[stage]) {
                auto& moves = objects[layer];
                moves.resize(std::max(moves.size(), step + 1));
                moves[step].insert(moves[step].end(), plan.objects[stage].begin(),
                                   plan.objects[stage].end());
            }
    }
    for (const auto& [layer, moves] : objects) findPathFields(layer, moves, index);
}

// Pcp plans the arcs that it composes. Others are below inactive prims or in variants that are not
// selected.
void Application::findPathFields(const SdfLayerRefPtr& layer, const std::vector<PathMoves>& objects,
                                 PathIndex& index) {
    StepMaps steps;
    for (const auto& moves : objects) steps.emplace_back(moves);
    pxr::SdfPathVector specs;
    for (std::size_t i = 0; i < objects.size(); ++i)
        for (const auto& move : objects[i])
            for (const SdfPath& path : pathsBefore(steps, i, move.from))
                index.of(layer).specsWithPathsTo(path, specs);
    const Planned& planned = planned_[layer];
    std::unordered_set<SdfPath, SdfPath::Hash> seen;
    for (const SdfPath& spec : specs) {
        if (!seen.insert(spec).second) continue;
        const SdfPath moved = after(layer, spec);
        if (moved.IsEmpty() || !layer->HasSpec(spec)) continue;
        const SdfPath owner = moved.StripAllVariantSelections();
        visitPathFields(layer, spec, [&](const TfToken& field, const VtValue& present) {
            const bool isArc = isArcField(field);
            if (isArc && planned.contains({spec, field})) return;
            VtValue value = present;
            for (const auto& moves : steps)
                if (auto next = isArc ? movedArcs(value, moves, owner) : movedValue(value, moves);
                    !next.IsEmpty())
                    value = std::move(next);
            if (value != present)
                changes_.fields[layer].push_back({spec, moved, field, present, value});
        });
    }
}

void Application::checkPermissions() {
    for (const auto& layer : changes_.layers()) {
        if (layer->PermissionToEdit()) continue;
        const auto fields = changes_.fields.find(layer);
        const bool isField = fields != changes_.fields.end() && !fields->second.empty();
        SdfPath path;
        if (isField) path = fields->second.front().before;
        for (const auto& step : changes_.steps)
            for (const auto& edit : step)
                if (const auto moves = edit.moves.find(layer);
                    path.IsEmpty() && moves != edit.moves.end())
                    path = moves->second.front().from;
        const std::string where = "@" + layer->GetIdentifier() + "@<" + path.GetString() + ">";
        errors_.push_back((isField
                               ? "The field " + fields->second.front().field.GetString() + " of "
                               : "The spec ") +
                          where + " cannot be edited because the layer is not editable");
    }
}

pxr::SdfLayerHandleVector Application::layers() const {
    pxr::SdfLayerHandleVector layers;
    for (const auto& layer : changes_.layers()) layers.push_back(layer);
    return layers;
}

Result<NamespaceRecord> Application::apply() const {
    const auto content = std::make_shared<NamespaceRecord::Content>(changes_);
    for (std::size_t i = 0; i < changes_.steps.size(); ++i) {
        if (auto made = makeStep(i, *content); !made) return tl::unexpected(made.error());
        content->end(i);  // Sdf removes emptied overs at the end of the block
    }
    return NamespaceRecord(content);
}

Result<void> Application::makeStep(std::size_t step, NamespaceRecord::Content& content) const {
    const pxr::SdfChangeBlock block;
    pxr::TfErrorMark mark;  // does not see errors of those who are notified of this step
    std::string refused;
    for (const auto& [layer, moves] : content.begin(step))
        if (!moveSpecs(layer, moves)) {
            refused = "@" + layer->GetIdentifier() + "@ refuses to move its specs";
            break;
        }
    if (refused.empty() && mark.IsClean()) changes_.notePlaces(step);
    if (refused.empty() && mark.IsClean() && step + 1 == changes_.steps.size()) writeFields();
    if (refused.empty() && mark.IsClean()) return {};
    if (!mark.IsClean()) refused += (refused.empty() ? "" : ": ") + mark.begin()->GetCommentary();
    (void)content.undo([](const SdfLayerHandle&) { return false; });
    mark.Clear();
    return fail(ErrorCode::InvalidEdit, refused);
}

void Application::writeFields() const {
    for (const auto& [layer, edits] : changes_.fields)
        for (const auto& edit : edits)
            if (layer->HasSpec(edit.path)) layer->SetField(edit.path, edit.field, edit.value);
}

}  // namespace usdlive::naming
