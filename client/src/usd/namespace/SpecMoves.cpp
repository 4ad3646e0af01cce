// Moves and deletes specs within one layer, many at a time.
#include "usd/namespace/SpecMoves.h"

#include <pxr/usd/sdf/layerStateDelegate.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "usdlive/common/usd/ChildOrder.h"

namespace usdlive::naming {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::VtValue;

namespace {

// Moves and deletes specs, and writes each list of children once. (SdfBatchNamespaceEdit copies the
// names of all siblings for each edit: 4,000 renames of siblings take 5 s.)
class Batch {
public:
    explicit Batch(SdfLayerHandle layer)
        : layer_(std::move(layer)), delegate_(layer_->GetStateDelegate()) {}

    // Returns false, and does nothing, if the layer does not have what is moved or the new parent,
    // or has something in the way.
    bool move(const PathMove& move) {
        const auto& [from, to] = move;
        const auto spec = layer_->GetObjectAtPath(from);
        if (!spec) return false;
        if (to.IsEmpty()) {
            namesAround(from).remove(from.GetNameToken());
            delegate_->DeleteSpec(from, spec->IsInert());
            return true;
        }
        if (!layer_->HasSpec(to.GetParentPath()) || layer_->HasSpec(to) || to.HasPrefix(from))
            return false;
        if (move.isReparent()) {
            namesAround(from).remove(from.GetNameToken());
            namesAround(to).place(to.GetNameToken(), {});
        } else {
            namesAround(from).rename(from.GetNameToken(), to.GetNameToken());
        }
        delegate_->MoveSpec(from, to);
        return true;
    }
    void writeNames() const {
        for (const auto& [list, order] : orders_) {
            const pxr::TfTokenVector names = order.names();
            layer_->SetField(list.first, list.second, names.empty() ? VtValue() : VtValue(names));
        }
    }

private:
    usd::ChildOrder& namesAround(const SdfPath& path) {
        const auto& keys = pxr::SdfChildrenKeys;
        const SdfPath parent = path.GetParentPath();
        const TfToken& field = path.IsPropertyPath() ? keys->PropertyChildren : keys->PrimChildren;
        const auto found = orders_.find({parent, field});
        if (found != orders_.end()) return found->second;
        usd::ChildOrder order(layer_->GetFieldAs<pxr::TfTokenVector>(parent, field, {}));
        return orders_.try_emplace({parent, field}, std::move(order)).first->second;
    }

    const SdfLayerHandle layer_;
    const pxr::SdfLayerStateDelegateBasePtr delegate_;
    std::map<std::pair<SdfPath, TfToken>, usd::ChildOrder> orders_;
};

// Removes overs that moves have left empty when the change block ends.
void removeEmptied(const SdfLayerHandle& layer, const PathMoves& moves) {
    std::set<SdfPath> parents;
    for (const auto& move : moves)
        if (move.isReparent()) parents.insert(move.from.GetParentPath());
    for (const SdfPath& parent : parents)
        if (const auto spec = layer->GetObjectAtPath(parent))
            layer->ScheduleRemoveIfInert(spec.GetSpec());
}

}  // namespace

bool moveSpecs(const SdfLayerHandle& layer, const PathMoves& moves, EmptiedOvers emptied) {
    if (!layer->PermissionToEdit()) return false;
    for (const auto& move : moves)
        if (move.isReparent() && !pxr::SdfJustCreatePrimInLayer(layer, move.to.GetParentPath()))
            return false;
    Batch batch(layer);
    const bool moved = std::ranges::all_of(moves, [&](const auto& one) { return batch.move(one); });
    batch.writeNames();
    // A delete alone leaves empty overs.
    if (moved && emptied == EmptiedOvers::Remove) removeEmptied(layer, moves);
    return moved;
}

}  // namespace usdlive::naming
