// Undoes namespace edits by moving specs back, so that later changes of other editors are kept.
#include "RecordContent.h"

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/propertySpec.h>

#include <algorithm>
#include <memory>
#include <ranges>

#include "SpecMoves.h"
#include "usd/content/LayerEdits.h"
#include "usd/content/ListMerge.h"
#include "usd/content/SpecEdits.h"
#include "usdlive/client/usd/content/Registers.h"

namespace usdlive {

using content::Kept;
using naming::PathMoves;
using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::VtValue;

NamespaceRecord::Content::Content(naming::Application::Layers layers) : layers_(std::move(layers)) {
    for (const auto& [layer, edits] : layers_) {
        PathMoves made;
        for (std::size_t i = 0; i < edits.moves.size(); ++i) {
            const auto& move = edits.moves[i];
            const SdfPath from = naming::pathBefore(made, move.from);
            made.push_back(move);
            if (from.IsEmpty()) continue;
            if (naming::isDeletedBy(edits.moves, i)) keepDeleted(layer, from);
            if (move.from.IsPrimPath()) keepOrder(layer, from.GetParentPath());
            if (move.to.IsEmpty()) continue;
            made.pop_back();
            for (const SdfPath& prefix :
                 naming::pathBefore(made, move.to.GetParentPath()).GetPrefixes())
                if (!layer->HasSpec(prefix)) madeOvers_.emplace_back(layer, prefix);
            made.push_back(move);
        }
        removeSurvivors(layer, edits.moves);
    }
}

void NamespaceRecord::Content::keepDeleted(const pxr::SdfLayerRefPtr& layer, const SdfPath& path) {
    if (!layer->HasSpec(path)) return;
    auto copy = pxr::SdfLayer::CreateAnonymous(".usda");
    const SdfPath owner = path.GetParentPath();
    if (owner != SdfPath::AbsoluteRootPath()) pxr::SdfJustCreatePrimInLayer(copy, owner);
    pxr::SdfCopySpec(layer, path, copy, path);
    deleted_.push_back({layer, path, std::move(copy)});
}

// Removes specs from the copies that were moved out before the delete. They return by their own
// moves.
void NamespaceRecord::Content::removeSurvivors(const pxr::SdfLayerRefPtr& layer,
                                               const PathMoves& moves) {
    PathMoves made;
    for (std::size_t i = 0; i < moves.size(); ++i) {
        const SdfPath from = naming::pathBefore(made, moves[i].from);
        made.push_back(moves[i]);
        if (from.IsEmpty() || naming::isDeletedBy(moves, i)) continue;
        for (const auto& deleted : deleted_)
            if (deleted.layer == layer && from.HasPrefix(deleted.path))
                content::removeSpec(deleted.copy, from);
    }
}

// Restores the last deleted spec first, because an earlier one may have been inside a later one.
// The early pass restores specs that moves may lead into, and only if their owner has not moved.
void NamespaceRecord::Content::restoreDeleted(bool early, std::set<std::size_t>& restored,
                                              std::vector<Kept>& kept) const {
    const auto cameWithAnother = [&](std::size_t i) {
        return std::ranges::any_of(restored, [&](std::size_t other) {
            return deleted_[other].layer == deleted_[i].layer &&
                   deleted_[i].path.HasPrefix(deleted_[other].path);
        });
    };
    for (std::size_t i = deleted_.size(); i-- > 0;) {
        const auto& [layer, path, copy] = deleted_[i];
        const SdfPath owner = path.GetParentPath();
        const bool hasOwner = layer->HasSpec(owner);
        if (restored.contains(i) ||
            (early && naming::followed(layers_.at(layer).moves, owner) != owner))
            continue;
        if (hasOwner && !layer->HasSpec(path)) {
            pxr::SdfCopySpec(copy, path, layer, path);
            restored.insert(i);
        } else if (!early && !cameWithAnother(i)) {
            kept.push_back(
                {layer->GetIdentifier(),
                 path,
                 {},
                 {},
                 hasOwner ? "another one has made it anew" : "what it was in is no longer there"});
        }
    }
}

void NamespaceRecord::Content::finish() {
    for (const auto& [layer, orders] : order_)
        for (const auto& [path, order] : orders) {
            const SdfPath now = naming::followed(layers_.at(layer).moves, path);
            if (!now.IsEmpty() && !layer->HasSpec(now)) cleanedUp_.emplace_back(layer, path);
        }
}

// Also records the prims above, which may be removed when nothing is left in them.
void NamespaceRecord::Content::keepOrder(const pxr::SdfLayerRefPtr& layer, const SdfPath& parent) {
    for (SdfPath at = parent; !at.IsEmpty(); at = at.GetParentPath())
        if (layer->HasSpec(at)) order_[layer].try_emplace(at, content::primChildren(layer, at));
}

std::vector<SdfLayerHandle> NamespaceRecord::Content::layers() const {
    std::vector<SdfLayerHandle> layers;
    for (const auto& [layer, edits] : layers_) layers.push_back(layer);
    return layers;
}

std::vector<Kept> NamespaceRecord::Content::undo(const content::Record::IsShared& isShared) const {
    const pxr::SdfChangeBlock block;
    std::vector<Kept> kept;
    std::set<std::size_t> restored;
    for (const auto& [layer, edits] : layers_) undoFields(layer, edits, !isShared(layer), kept);
    restoreDeleted(true, restored, kept);
    for (const auto& [layer, edits] : layers_) undoMoves(layer, edits, kept);
    for (const auto& [layer, path] : cleanedUp_)
        if (!layer->HasSpec(path)) pxr::SdfJustCreatePrimInLayer(layer, path);
    restoreDeleted(false, restored, kept);
    for (const auto& [layer, path] : std::views::reverse(madeOvers_))
        if (const auto prim = layer->GetPrimAtPath(path); prim && prim->IsInert())
            content::removeSpec(layer, path);  // and no parents, as RemovePrimIfInert() does
    for (const auto& [layer, edits] : layers_) arrangeChildren(layer);
    return kept;
}

void NamespaceRecord::Content::undoFields(const SdfLayerHandle& layer, const LayerEdits& edits,
                                          bool force, std::vector<Kept>& kept) const {
    for (const auto& edit : std::views::reverse(edits.fields)) {
        if (!layer->HasSpec(edit.path)) {
            kept.push_back(
                {layer->GetIdentifier(), edit.path, edit.field, {}, "it is no longer there"});
            continue;
        }
        for (const auto& change : content::changesBetween(edit.path, {{edit.field, edit.oldValue}},
                                                          {{edit.field, edit.value}})) {
            const auto write = [&](const VtValue& value) {
                content::writeRegister(layer, edit.path, edit.field, change.part, value);
            };
            const auto present = content::readRegister(layer, edit.path, edit.field, change.part);
            if (force || content::isSame(present, change.after))
                write(change.before);
            else if (const auto merged = content::undoneList(present, change.after, change.before))
                write(*merged);
            else if (!content::isSame(present, change.before))
                kept.push_back({layer->GetIdentifier(), edit.path, edit.field, change.part,
                                "it was written by another one since"});
        }
    }
}

// Objects that were deleted later are not moved back. restoreDeleted() restores them at their first
// path. Overs that become empty stay, because some were empty before; undo() removes those that the
// batch made.
void NamespaceRecord::Content::undoMoves(const SdfLayerHandle& layer, const LayerEdits& edits,
                                         std::vector<Kept>& kept) const {
    PathMoves back;
    for (std::size_t i = edits.moves.size(); i-- > 0;) {
        const auto& [from, to] = edits.moves[i];
        if (naming::isDeletedBy(edits.moves, i)) continue;
        back.push_back({to, from});
    }
    const auto refusal = [&](const naming::PathMove& move) -> std::string {
        if (!layer->HasSpec(move.from)) return "it is no longer there";
        return layer->HasSpec(move.to) ? "another one has made it anew" : std::string();
    };
    if (back.size() == 1) {
        if (auto reason = refusal(back.front()); !reason.empty())
            kept.push_back({layer->GetIdentifier(), back.front().from, {}, {}, std::move(reason)});
        else
            (void)naming::moveSpecs(layer, back, naming::EmptiedOvers::Keep);
        return;
    }
    if (naming::canMoveSpecs(layer, back)) {
        (void)naming::moveSpecs(layer, back, naming::EmptiedOvers::Keep);
        return;
    }
    for (const auto& move : back)
        if (auto reason = refusal(move); !reason.empty())
            kept.push_back({layer->GetIdentifier(), move.from, {}, {}, std::move(reason)});
        else
            (void)naming::moveSpecs(layer, {move}, naming::EmptiedOvers::Keep);
}

void NamespaceRecord::Content::arrangeChildren(const SdfLayerHandle& layer) const {
    const auto orders = order_.find(layer);
    if (orders == order_.end()) return;
    for (const auto& [parent, order] : orders->second)
        if (content::primChildren(layer, parent) != order)
            content::arrange(layer, parent, order, {order.begin(), order.end()});
}

NamespaceRecord::NamespaceRecord() = default;
NamespaceRecord::NamespaceRecord(std::shared_ptr<const Content> content)
    : content_(std::move(content)) {}

bool NamespaceRecord::isEmpty() const { return !content_ || content_->layers().empty(); }

std::vector<SdfLayerHandle> NamespaceRecord::layers() const {
    return content_ ? content_->layers() : std::vector<SdfLayerHandle>();
}

std::vector<Kept> NamespaceRecord::undo(const content::Record::IsShared& isShared) const {
    return content_ ? content_->undo(isShared) : std::vector<Kept>();
}

}  // namespace usdlive
