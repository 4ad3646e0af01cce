// Changes a layer's content by writing only the differences.
#include "usd/content/LayerEdits.h"

#include <pxr/base/tf/errorMark.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/namespaceEdit.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "usd/content/SpecEdits.h"
#include "usdlive/client/usd/content/Registers.h"
#include "usdlive/common/layer/LongestIncreasing.h"

namespace usdlive::content {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::TfToken;
using pxr::TfTokenVector;
using pxr::VtValue;

namespace {

using Places = std::unordered_map<TfToken, std::size_t, TfToken::HashFunctor>;

Places placesOf(const TfTokenVector& names) {
    Places places;
    for (std::size_t i = 0; i < names.size(); ++i) places.emplace(names[i], i);
    return places;
}

// Sdf copies the names of all children for each move. Setting the order takes as long as several
// moves.
constexpr std::size_t kFewMoves = 8;

void setOrder(const SdfLayerHandle& layer, const SdfPath& parent, const TfTokenVector& order) {
    pxr::SdfPrimSpecHandleVector prims;
    for (const TfToken& name : order)
        prims.push_back(layer->GetPrimAtPath(parent.AppendChild(name)));
    layer->GetPrimAtPath(parent)->SetNameChildren(prims);
}

// Moves a child to the place behind `previous`, or to the first one if that is empty.
void moveBehind(const SdfLayerHandle& layer, const SdfPath& parent, const TfToken& name,
                const TfToken& previous) {
    const auto names = primChildren(layer, parent);
    const auto place = std::ranges::find(names, previous);
    const auto index = place == names.end() ? 0 : place - names.begin() + 1;
    pxr::SdfBatchNamespaceEdit edits;
    edits.Add(pxr::SdfNamespaceEdit::Reorder(parent.AppendChild(name), int(index)));
    pxr::TfErrorMark errors;  // OpenUSD 26.8 succeeds but reports that the paths overlap
    layer->Apply(edits);
    errors.Clear();
}

// Returns the smallest set of names that have to move to bring `names` into `order`.
std::set<TfToken> misplaced(const TfTokenVector& names, const TfTokenVector& order) {
    const Places places = placesOf(order);
    std::vector<std::size_t> numbers;
    for (const TfToken& name : names) {
        const auto place = places.find(name);
        numbers.push_back(place == places.end() ? kNotThere : place->second);
    }
    const auto stays = longestIncreasing(numbers);
    std::set<TfToken> moving;
    for (std::size_t i = 0; i < names.size(); ++i)
        if (numbers[i] != kNotThere && !stays[i]) moving.insert(names[i]);
    return moving;
}

SdfPath movedPath(const SdfPath& path, const Moves& moves) {
    for (const auto& [from, to] : moves)
        if (path.HasPrefix(from)) return path.ReplacePrefix(from, to);
    return path;
}

template <class Arc>
Arc movedArc(Arc arc, const Moves& moves) {
    if (arc.GetAssetPath().empty()) arc.SetPrimPath(movedPath(arc.GetPrimPath(), moves));
    return arc;
}

template <class Item, class Move>
bool modifyItems(VtValue& value, const Move& move) {
    if (!value.IsHolding<pxr::SdfListOp<Item>>()) return false;
    auto op = value.UncheckedGet<pxr::SdfListOp<Item>>();
    if (!op.ModifyOperations([&](const Item& item) { return std::optional<Item>(move(item)); }))
        return false;
    value = VtValue::Take(op);
    return true;
}

// Changes the value if it refers to an old path. Returns true if it did.
bool retargeted(VtValue& value, const Moves& moves) {
    const auto arc = [&](const auto& item) { return movedArc(item, moves); };
    return modifyItems<SdfPath>(value, [&](const auto& path) { return movedPath(path, moves); }) ||
           modifyItems<pxr::SdfReference>(value, arc) || modifyItems<pxr::SdfPayload>(value, arc);
}

}  // namespace

std::vector<SdfPath> pathsBelow(const SdfLayerHandle& layer, const SdfPath& root) {
    std::vector<SdfPath> paths;
    if (!layer->HasSpec(root)) return paths;
    layer->Traverse(root, [&](const SdfPath& path) {
        if (!path.IsTargetPath()) paths.push_back(path);
    });
    std::ranges::reverse(paths);
    return paths;
}

SdfPath ownerOf(const SdfPath& path) {
    const SdfPath parent = path.GetParentPath();
    if (!path.IsPrimVariantSelectionPath()) return parent;
    const auto [set, variant] = path.GetVariantSelection();
    return variant.empty() ? parent : parent.AppendVariantSelection(set, "");
}

TfTokenVector primChildren(const SdfLayerHandle& layer, const SdfPath& parent) {
    return layer->GetFieldAs<TfTokenVector>(parent, pxr::SdfChildrenKeys->PrimChildren);
}

TfTokenVector arranged(const TfTokenVector& children, const TfTokenVector& order,
                       const std::set<TfToken>& names) {
    const Places places = placesOf(children);
    std::vector<TfTokenVector> moved(children.size() + 1);  // before each child, and at the end
    std::vector<bool> moves(children.size());
    std::size_t next = 0;  // after all visited ones
    for (const TfToken& name : order) {
        const auto place = places.find(name);
        if (place == places.end()) continue;
        if (names.contains(name)) {
            moves[place->second] = true;
            moved[next].push_back(name);
        } else {
            next = std::max(next, place->second + 1);
        }
    }
    TfTokenVector result = std::move(moved[0]);
    for (std::size_t i = 0; i < children.size(); ++i) {
        if (!moves[i]) result.push_back(children[i]);
        std::ranges::move(moved[i + 1], std::back_inserter(result));
    }
    return result;
}

void arrange(const SdfLayerHandle& layer, const SdfPath& parent, const TfTokenVector& order,
             const std::set<TfToken>& names) {
    const auto present = primChildren(layer, parent);
    const auto wanted = arranged(present, order, names);
    if (wanted == present || !layer->PermissionToEdit()) return;
    const auto moving = misplaced(present, wanted);
    if (moving.size() > kFewMoves) return setOrder(layer, parent, wanted);
    for (std::size_t i = 0; i < wanted.size(); ++i)
        if (moving.contains(wanted[i]))
            moveBehind(layer, parent, wanted[i], i > 0 ? wanted[i - 1] : TfToken());
}

void makeLike(const SdfLayerHandle& layer, const SdfLayerHandle& wanted, const SdfPath& root) {
    using Paths = std::unordered_set<SdfPath, SdfPath::Hash>;
    const pxr::SdfChangeBlock block;
    const auto wantedPaths = pathsBelow(wanted, root), presentPaths = pathsBelow(layer, root);
    const Paths want(wantedPaths.begin(), wantedPaths.end());
    const Paths have(presentPaths.begin(), presentPaths.end());
    for (const SdfPath& path : presentPaths)
        if (!want.contains(path) && (path == root || want.contains(ownerOf(path))))
            removeSpec(layer, path);
    for (const SdfPath& path : wantedPaths) {
        if (!have.contains(path)) {
            if (have.contains(ownerOf(path))) pxr::SdfCopySpec(wanted, path, layer, path);
            continue;
        }
        for (const Change& change :
             changesBetween(path, readFields(layer, path), readFields(wanted, path)))
            writeRegister(layer, path, change.field, change.part, change.after);
    }
    for (const SdfPath& path : wantedPaths) {
        if (path.IsPropertyPath()) continue;
        const auto order = primChildren(wanted, path), present = primChildren(layer, path);
        if (order != present) arrange(layer, path, order, misplaced(present, order));
    }
}

void takeMetadata(const SdfLayerHandle& content, const SdfLayerHandle& layer) {
    const SdfPath root = SdfPath::AbsoluteRootPath();
    for (const Change& change :
         changesBetween(root, readFields(content, root), readFields(layer, root)))
        if (change.field != pxr::SdfFieldKeys->SubLayers)
            writeRegister(content, root, change.field, change.part, change.after);
}

void retarget(const SdfLayerHandle& layer, const Moves& moves) {
    const auto& keys = pxr::SdfFieldKeys;
    const pxr::SdfChangeBlock block;
    for (const SdfPath& path : pathsBelow(layer, SdfPath::AbsoluteRootPath()))
        for (const auto& field : {keys->TargetPaths, keys->ConnectionPaths, keys->InheritPaths,
                                  keys->Specializes, keys->References, keys->Payload})
            if (VtValue value = layer->GetField(path, field); retargeted(value, moves))
                writeRegister(layer, path, field, {}, value);
}

}  // namespace usdlive::content
