// Finds and replaces paths in field values, with the value transforms of Vt.
#include "usd/namespace/PathValues.h"

#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/valueTransform.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>
#include <optional>
#include <string>

#include "usd/content/PathListItems.h"
#include "usd/stage/DepthGuard.h"

namespace usdlive::naming {

using pxr::SdfPath;
using pxr::SdfPathExpression;
using pxr::SdfPathListOp;
using pxr::TfToken;
using pxr::VtValue;

namespace {

struct Collect {
    pxr::SdfPathSet& paths;

    // Leaves out paths that Sdf cannot compare. No prim has them.
    void add(const SdfPath& path) const {
        if (!path.IsEmpty() && !stage::isTooDeep(path.GetPrimPath())) paths.insert(path);
    }
};

SdfPath movedPath(const SdfPath& path, const PathMap& moves) { return moves.after(path); }
SdfPath collectPath(const SdfPath& path, const Collect& collect) {
    collect.add(path);
    return path;
}

SdfPathListOp movedList(const SdfPathListOp& list, const PathMap& moves) {
    SdfPathListOp moved = list;
    moved.ModifyOperations([&](const SdfPath& path) -> std::optional<SdfPath> {
        auto to = movedPath(path, moves);
        if (to.IsEmpty()) return std::nullopt;
        return to;
    });
    return moved;
}
SdfPathListOp collectList(const SdfPathListOp& list, const Collect& collect) {
    content::forEachPath(list, [&](const SdfPath& path) { collect.add(path); });
    return list;
}

// Returns the path of the prim that an internal arc leads to, or an empty path for other arcs.
SdfPath internalTarget(const SdfPath& arc) { return arc; }
template <class Arc>
SdfPath internalTarget(const Arc& arc) {
    return arc.GetAssetPath().empty() ? arc.GetPrimPath() : SdfPath();
}
void setTarget(SdfPath& arc, const SdfPath& path) { arc = path; }
template <class Arc>
void setTarget(Arc& arc, const SdfPath& path) {
    arc.SetPrimPath(path);
}

template <class Arc>
VtValue movedArcList(const pxr::SdfListOp<Arc>& list, const PathMap& moves, const SdfPath& owner) {
    auto moved = list;
    const bool differs = moved.ModifyOperations([&](const Arc& arc) -> std::optional<Arc> {
        const SdfPath from = internalTarget(arc);
        const auto move = moves.nearest(from);
        if (!move) return arc;
        const SdfPath to = from.ReplacePrefix(move->from, move->to);
        if (to.IsEmpty() || to.HasPrefix(owner) || owner.HasPrefix(to)) return std::nullopt;
        Arc other = arc;
        setTarget(other, to);
        return other;
    });
    return differs ? VtValue::Take(moved) : VtValue();
}

template <class Arc>
bool collectArcs(const VtValue& value, const Collect& collect) {
    if (!value.IsHolding<pxr::SdfListOp<Arc>>()) return false;
    content::forEachItem(value.UncheckedGet<pxr::SdfListOp<Arc>>(),
                         [&](const Arc& arc) { collect.add(internalTarget(arc)); });
    return true;
}

SdfPathExpression collectExpression(const SdfPathExpression& expression, const Collect& collect) {
    const auto logic = [](SdfPathExpression::Op, int) {};
    const auto reference = [&](const SdfPathExpression::ExpressionReference& one) {
        collect.add(one.path);
    };
    const auto pattern = [&](const SdfPathExpression::PathPattern& one) {
        collect.add(one.GetPrefix());
    };
    expression.Walk(logic, reference, pattern);
    return expression;
}

// Sdf replaces one prefix after another. Names in between keep a moved path from being moved again.
SdfPathExpression movedExpression(const SdfPathExpression& expression, const PathMap& moves) {
    pxr::SdfPathSet paths;
    (void)collectExpression(expression, {paths});
    PathMoves used;
    for (const auto& path : paths)
        if (const auto move = moves.nearest(path);
            move && std::ranges::find(used, *move) == used.end())
            used.push_back(*move);
    if (used.empty()) return expression;
    if (used.size() == 1) return expression.ReplacePrefix(used.front().from, used.front().to);
    std::ranges::sort(used, [](const auto& a, const auto& b) { return b.from < a.from; });
    SdfPathExpression moved = expression;
    for (auto& move : used) {
        const SdfPath between("/__usdlive_moved_" + std::to_string(&move - used.data()));
        moved = moved.ReplacePrefix(move.from, move.to.IsEmpty() ? move.to : between);
        move.from = between;
    }
    for (const auto& move : used)
        if (!move.to.IsEmpty()) moved = moved.ReplacePrefix(move.from, move.to);
    return moved;
}

// Vt applies these functions to the values inside dictionaries and time samples.
void registerTransforms() {
    [[maybe_unused]] static const bool registered = [] {
        pxr::VtRegisterTransform(movedPath);
        pxr::VtRegisterTransform(movedList);
        pxr::VtRegisterTransform(movedExpression);
        pxr::VtRegisterTransform(collectPath);
        pxr::VtRegisterTransform(collectList);
        pxr::VtRegisterTransform(collectExpression);
        return true;
    }();
}

bool isExpression(const pxr::SdfLayerHandle& layer, const SdfPath& attribute) {
    TfToken type;
    if (!layer->HasField(attribute, pxr::SdfFieldKeys->TypeName, &type)) return true;
    const auto known = pxr::SdfSchema::GetInstance().FindType(type);
    return !known || known.GetScalarType() == pxr::SdfValueTypeNames->PathExpression;
}

}  // namespace

VtValue movedValue(const VtValue& value, const PathMap& moves) {
    if (value.IsHolding<SdfPathListOp>()) {  // most values: the targets of a property
        const auto& list = value.UncheckedGet<SdfPathListOp>();
        bool isMoved = false;
        content::forEachPath(
            list, [&](const SdfPath& path) { isMoved = isMoved || moves.nearest(path); });
        return isMoved ? VtValue(movedList(list, moves)) : VtValue();
    }
    registerTransforms();
    auto moved = pxr::VtValueTryTransform(value, moves);
    return moved == value ? VtValue() : moved;
}

VtValue movedArcs(const VtValue& value, const PathMap& moves, const SdfPath& owner) {
    if (value.IsHolding<SdfPathListOp>())
        return movedArcList(value.UncheckedGet<SdfPathListOp>(), moves, owner);
    if (value.IsHolding<pxr::SdfReferenceListOp>())
        return movedArcList(value.UncheckedGet<pxr::SdfReferenceListOp>(), moves, owner);
    if (value.IsHolding<pxr::SdfPayloadListOp>())
        return movedArcList(value.UncheckedGet<pxr::SdfPayloadListOp>(), moves, owner);
    return {};
}

bool isArcField(const TfToken& field) {
    const auto& keys = pxr::SdfFieldKeys;
    return field == keys->InheritPaths || field == keys->Specializes || field == keys->References ||
           field == keys->Payload;
}

bool collectPaths(const VtValue& value, pxr::SdfPathSet& paths) {
    const Collect collect{paths};
    if (collectArcs<SdfPath>(value, collect) || collectArcs<pxr::SdfReference>(value, collect) ||
        collectArcs<pxr::SdfPayload>(value, collect))
        return true;
    registerTransforms();
    return !pxr::VtValueTryTransform(value, collect).IsEmpty();
}

// Decides by types, so that no value is read from a file.
bool canHavePaths(const pxr::SdfLayerHandle& layer, const SdfPath& spec, const TfToken& field) {
    const auto& type = layer->GetFieldTypeid(spec, field);
    if (type == typeid(pxr::SdfTimeSampleMap)) return isExpression(layer, spec);
    return type == typeid(SdfPathListOp) || type == typeid(pxr::SdfReferenceListOp) ||
           type == typeid(pxr::SdfPayloadListOp) || type == typeid(SdfPath) ||
           type == typeid(SdfPathExpression) || type == typeid(pxr::VtDictionary) ||
           type == typeid(pxr::VtArray<SdfPath>) || type == typeid(pxr::VtArray<SdfPathExpression>);
}

}  // namespace usdlive::naming
