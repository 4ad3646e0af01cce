// Undoes namespace edits by moving specs back, so that later changes of other editors are kept.
#include "usd/namespace/RecordContent.h"

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <memory>
#include <ranges>

#include "usd/content/LayerEdits.h"
#include "usd/content/ListMerge.h"
#include "usd/content/SpecEdits.h"
#include "usd/namespace/SpecMoves.h"
#include "usdlive/client/usd/Misuse.h"
#include "usdlive/client/usd/content/Registers.h"

namespace usdlive {

using pxr::SdfLayerHandle;
using pxr::SdfLayerRefPtr;
using pxr::SdfPath;
using pxr::VtValue;

namespace {

constexpr const char* kGone = "it is no longer there";
constexpr const char* kMadeAnew = "another one has made it anew";

// Returns the reason why a spec cannot go back, or an empty string.
std::string refusal(const SdfLayerRefPtr& layer, const naming::PathMove& move) {
    if (!layer->PermissionToEdit()) return "the layer is not editable";
    if (move.to.IsEmpty()) {
        if (!layer->HasSpec(move.from.GetParentPath())) return "what it was in is no longer there";
    } else if (!layer->HasSpec(move.to)) {
        return kGone;
    }
    return layer->HasSpec(move.from) ? kMadeAnew : std::string();
}

template <class Visit>
void forEachMove(const std::map<SdfLayerHandle, naming::PathMoves>& layers, const Visit& visit) {
    for (const auto& [layer, moves] : layers)
        for (const auto& move : moves) visit(SdfLayerRefPtr(layer), move);
}

}  // namespace

NamespaceRecord::Content::Content(naming::Changes changes)
    : changes_(std::move(changes)), staying_(changes_.steps.size()) {}

const NamespaceRecord::Content::LayerMoves& NamespaceRecord::Content::begin(std::size_t step) {
    Done& done = done_.emplace_back();
    for (const auto& edit : changes_.steps[step])
        for (const auto& [layer, moves] : edit.moves) {
            auto& all = done.moves[layer];
            all.insert(all.end(), moves.begin(), moves.end());
        }
    for (const auto& [layer, moves] : done.moves)
        for (const auto& move : moves) {
            keepParents(done, layer, move);
            if (!move.to.IsEmpty() || !layer->HasSpec(move.from)) continue;
            auto& copy = done.deleted[layer];
            if (!copy) copy = pxr::SdfLayer::CreateAnonymous(".usda");
            const SdfPath owner = move.from.GetParentPath();
            if (owner != SdfPath::AbsoluteRootPath()) pxr::SdfJustCreatePrimInLayer(copy, owner);
            pxr::SdfCopySpec(layer, move.from, copy, move.from);
        }
    return done.moves;
}

// Records the children of the prims above, which may be removed when nothing is left in them.
void NamespaceRecord::Content::keepParents(Done& done, const SdfLayerRefPtr& layer,
                                           const naming::PathMove& move) {
    if (move.from.IsPrimPath() || move.from.IsPrimVariantSelectionPath())
        for (SdfPath at = move.from.GetParentPath(); !at.IsEmpty(); at = at.GetParentPath()) {
            const LayerPath parent(layer, at);
            if (done.order.contains(parent)) break;
            if (layer->HasSpec(at)) done.order[parent] = content::primChildren(layer, at);
        }
    if (move.to.IsEmpty()) return;
    pxr::SdfPathVector missing;
    for (SdfPath at = move.to.GetParentPath(); !at.IsEmpty() && !layer->HasSpec(at);
         at = at.GetParentPath())
        missing.push_back(at);
    for (const SdfPath& path : std::views::reverse(missing))
        done.madeOvers.push_back({layer, path});
}

void NamespaceRecord::Content::end(std::size_t step) {
    Done& done = done_[step];
    for (const auto& [parent, order] : done.order)
        if (!parent.first->HasSpec(parent.second)) done.cleanedUp.push_back(parent);
}

std::vector<SdfLayerHandle> NamespaceRecord::Content::layers() const {
    std::vector<SdfLayerHandle> layers;
    for (const auto& layer : changes_.layers()) layers.push_back(layer);
    return layers;
}

std::vector<content::Kept> NamespaceRecord::Content::undo(
    const content::Record::IsShared& isShared) {
    if (std::this_thread::get_id() != thread_)
        throw Misuse({ErrorCode::InvalidEdit,
                      "NamespaceRecord: undo was called on another thread than the one that made "
                      "the edits"});
    Kept kept;
    for (std::size_t step = done_.size(); step-- > 0;) {
        const pxr::SdfChangeBlock block;
        undoStep(step, kept);
        if (step == 0) undoFields(isShared, kept);
    }
    changes_ = {};
    done_.clear();
    return kept;
}

void NamespaceRecord::Content::undoStep(std::size_t step, Kept& kept) {
    const Done& done = done_[step];
    for (const auto& [layer, path] : done.cleanedUp)
        if (!layer->HasSpec(path)) pxr::SdfJustCreatePrimInLayer(layer, path);
    undoMoves(step, kept);
    for (const auto& [layer, path] : std::views::reverse(done.madeOvers))
        if (const auto prim = layer->GetPrimAtPath(path); prim && prim->IsInert())
            content::removeSpec(layer, path);  // and no parents, as RemovePrimIfInert() does
    for (const auto& [parent, order] : done.order) {
        const auto& [layer, path] = parent;
        if (layer->HasSpec(path) && content::primChildren(layer, path) != order)
            content::arrange(layer, path, order, {order.begin(), order.end()});
    }
}

// The moves of one edit go back in all layers or in none. What it deleted is restored where this is
// possible.
void NamespaceRecord::Content::undoMoves(std::size_t step, Kept& kept) {
    LayerMoves back;
    std::vector<LayerPath> restored;
    for (const auto& [plan, layers] : changes_.steps[step]) {
        bool stays = stays_.contains(plan);
        std::set<LayerPath> refused;
        forEachMove(layers, [&](const auto& layer, const auto& move) {
            auto reason = refusal(layer, move);
            if (reason.empty()) return;
            const SdfPath& path = move.to.IsEmpty() ? move.from : move.to;
            kept.push_back({layer->GetIdentifier(), path, {}, {}, std::move(reason)});
            refused.insert({layer, move.from});
            stays = stays || !move.to.IsEmpty();
        });
        bool isUndone = layers.empty();
        forEachMove(layers, [&](const auto& layer, const auto& move) {
            if (stays || refused.contains({layer, move.from})) {
                staying_[step][layer].add(move);
                return;
            }
            isUndone = true;
            if (move.to.IsEmpty())
                restored.push_back({layer, move.from});
            else
                back[layer].push_back({move.to, move.from});
        });
        if (!isUndone) stays_.insert(plan);
    }
    for (const auto& [layer, moves] : back)
        (void)naming::moveSpecs(layer, moves, naming::EmptiedOvers::Keep);
    for (const auto& [layer, path] : restored)
        if (const auto copy = done_[step].deleted.find(layer); copy != done_[step].deleted.end())
            pxr::SdfCopySpec(copy->second, path, layer, path);
    changes_.notePlacesBack(step, [&](std::size_t plan) { return !stays_.contains(plan); });
}

// Relocates move objects, too. If they stay, so does what refers to the objects.
void NamespaceRecord::Content::undoFields(const content::Record::IsShared& isShared, Kept& kept) {
    const auto undoAll = [&](bool relocates) {
        for (const auto& [layer, edits] : changes_.fields)
            for (const auto& edit : std::views::reverse(edits))
                if (relocates == (edit.field == pxr::SdfFieldKeys->LayerRelocates))
                    undoField(layer, edit, !isShared(layer), kept);
    };
    const std::size_t before = kept.size();
    undoAll(true);
    if (kept.size() > before)
        for (std::size_t plan = 0; plan < changes_.objects.size(); ++plan)
            if (changes_.objects[plan].hasRelocates) stays_.insert(plan);
    undoAll(false);
}

SdfPath NamespaceRecord::Content::pathNow(const SdfLayerRefPtr& layer, SdfPath path) const {
    for (const auto& step : staying_)
        if (const auto moves = step.find(layer); moves != step.end() && !path.IsEmpty())
            path = moves->second.after(path);
    return path;
}

// Returns the old value with the paths of the objects that stay at their new place.
VtValue NamespaceRecord::Content::valueBefore(const SdfLayerRefPtr& layer,
                                              const naming::FieldEdit& edit,
                                              const SdfPath& owner) const {
    if (stays_.empty()) return edit.oldValue;
    std::map<std::size_t, naming::PathMap> steps;
    for (const std::size_t plan : stays_) {
        const auto& objects = changes_.objects[plan];
        for (std::size_t stage = 0; stage < objects.moves.size(); ++stage)
            if (std::ranges::find(objects.localLayers[stage], SdfLayerHandle(layer)) !=
                objects.localLayers[stage].end())
                for (const auto& move : objects.moves[stage]) steps[objects.step].add(move);
    }
    VtValue value = edit.oldValue;
    for (const auto& [step, moves] : steps) {
        auto next = naming::isArcField(edit.field)
                        ? naming::movedArcs(value, moves, owner.StripAllVariantSelections())
                        : naming::movedValue(value, moves);
        if (!next.IsEmpty()) value = std::move(next);
    }
    return value;
}

void NamespaceRecord::Content::undoField(const SdfLayerRefPtr& layer, const naming::FieldEdit& edit,
                                         bool force, Kept& kept) {
    const SdfPath path = pathNow(layer, edit.before);
    if (path.IsEmpty() || !layer->HasSpec(path)) {
        kept.push_back({layer->GetIdentifier(), edit.path, edit.field, {}, kGone});
        return;
    }
    const VtValue before = valueBefore(layer, edit, path);
    for (const auto& change :
         content::changesBetween(path, {{edit.field, before}}, {{edit.field, edit.value}})) {
        const auto write = [&](const VtValue& value) {
            content::writeRegister(layer, path, edit.field, change.part, value);
        };
        const auto present = content::readRegister(layer, path, edit.field, change.part);
        if (force || content::isSame(present, change.after))
            write(change.before);
        else if (const auto merged = content::undoneList(present, change.after, change.before))
            write(*merged);
        else if (!content::isSame(present, change.before))
            kept.push_back({layer->GetIdentifier(), path, edit.field, change.part,
                            "it was written by another one since"});
    }
}

NamespaceRecord::NamespaceRecord() = default;
NamespaceRecord::NamespaceRecord(std::shared_ptr<Content> content) : content_(std::move(content)) {}

bool NamespaceRecord::isEmpty() const { return !content_ || content_->layers().empty(); }

std::vector<SdfLayerHandle> NamespaceRecord::layers() const {
    return content_ ? content_->layers() : std::vector<SdfLayerHandle>();
}

std::vector<content::Kept> NamespaceRecord::undo(const content::Record::IsShared& isShared) const {
    return content_ ? content_->undo(isShared) : std::vector<content::Kept>();
}

}  // namespace usdlive
