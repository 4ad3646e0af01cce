// Composes metadata fields, specifiers and type names from the opinions of all sites.
#include "usd/stage/Opinions.h"

#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/schema.h>

#include <optional>
#include <ranges>
#include <set>

#include "usdlive/client/usd/stage/ValueSite.h"

namespace usdlive::stage {

using pxr::PcpNodeRef;
using pxr::PcpPrimIndex;
using pxr::SdfFieldKeys;
using pxr::SdfPath;
using pxr::SdfPathExpression;
using pxr::TfToken;
using pxr::VtArray;
using pxr::VtDictionary;
using pxr::VtValue;

namespace {

// Changes a value of type T in place. Returns false if the value has another type.
template <class T, class Change>
bool changeHeld(VtValue& value, Change&& change) {
    if (!value.IsHolding<T>()) return false;
    T held;
    value.UncheckedSwap(held);
    change(held);
    value.UncheckedSwap(held);
    return true;
}

template <class T, class Change>
bool changeEach(VtValue& value, Change&& change) {
    return changeHeld<T>(value, change) || changeHeld<VtArray<T>>(value, [&](VtArray<T>& array) {
               for (T& one : array) change(one);
           });
}

// The prims of an instance are composed from the source of its prototype. Paths inside the source
// are mapped to the instance.
SdfPathExpression mapExpression(const SdfPathExpression& expression, const PathMapper& mapPath) {
    std::vector<SdfPathExpression> stack;
    const auto combine = [&](SdfPathExpression::Op op, int argument) {
        if (op == SdfPathExpression::Complement) {
            if (argument == 1)
                stack.back() = SdfPathExpression::MakeComplement(std::move(stack.back()));
        } else if (argument == 2) {
            auto right = std::move(stack.back());
            stack.pop_back();
            stack.back() = SdfPathExpression::MakeOp(op, std::move(stack.back()), std::move(right));
        }
    };
    const auto reference = [&](SdfPathExpression::ExpressionReference one) {
        if (!one.path.IsEmpty()) one.path = mapPath(one.path);
        stack.push_back(SdfPathExpression::MakeAtom(std::move(one)));
    };
    const auto pattern = [&](SdfPathExpression::PathPattern one) {
        if (!one.HasLeadingStretch()) one.SetPrefix(mapPath(one.GetPrefix()));
        stack.push_back(SdfPathExpression::MakeAtom(std::move(one)));
    };
    expression.Walk(combine, reference, pattern);
    return stack.empty() ? SdfPathExpression() : stack.back();
}

// Returns true for types whose weaker opinions are merged with the stronger ones.
bool mergesWeaker(const VtValue& value) {
    return value.IsHolding<VtDictionary>() || value.IsHolding<SdfPathExpression>() ||
           value.IsHolding<VtArray<SdfPathExpression>>();
}

VtValue mergedOver(VtValue strong, const VtValue& weak) {
    if (strong.IsHolding<VtDictionary>() && weak.IsHolding<VtDictionary>()) {
        changeHeld<VtDictionary>(strong, [&](VtDictionary& into) {
            pxr::VtDictionaryOverRecursive(&into, weak.UncheckedGet<VtDictionary>());
        });
    } else if (strong.IsHolding<SdfPathExpression>() && weak.IsHolding<SdfPathExpression>()) {
        changeHeld<SdfPathExpression>(strong, [&](SdfPathExpression& into) {
            into = std::move(into).ComposeOver(weak.UncheckedGet<SdfPathExpression>());
        });
    } else if (strong.IsHolding<VtArray<SdfPathExpression>>() &&
               weak.IsHolding<VtArray<SdfPathExpression>>()) {
        const auto& others = weak.UncheckedGet<VtArray<SdfPathExpression>>();
        changeHeld<VtArray<SdfPathExpression>>(strong, [&](auto& into) {
            if (into.size() != others.size()) return;
            for (std::size_t i = 0; i < into.size(); ++i)
                into[i] = SdfPathExpression(into[i]).ComposeOver(others[i]);
        });
    }
    return strong;
}

// Composes the list operations of all sites. As in pxr.Usd, a weaker one is left out if it cannot
// be composed with the stronger ones, because one of the two adds or reorders. The result is one
// explicit list.
template <class ListOp>
VtValue applied(const PcpPrimIndex& index, const TfToken& property, const TfToken& field) {
    std::optional<ListOp> composed;
    forEachSite(index, property, [&](const Site& site) {
        ListOp weaker;
        if (!site.layer->HasField(site.path, field, &weaker)) return true;
        if (!composed)
            composed = std::move(weaker);
        else if (auto both = composed->ApplyOperations(weaker))
            composed = std::move(both);
        return !composed->IsExplicit();
    });
    typename ListOp::ItemVector items;
    if (composed) composed->ApplyOperations(&items);
    ListOp result;
    result.SetExplicitItems(items);
    return VtValue::Take(result);
}

template <class... ListOps>
bool applyListOps(VtValue& value, const PcpPrimIndex& index, const TfToken& property,
                  const TfToken& field) {
    return (
        (value.IsHolding<ListOps>() && (value = applied<ListOps>(index, property, field), true)) ||
        ...);
}

// Returns true if the node exists because a prim inherits from it, directly and not because of an
// ancestor.
bool isInherited(PcpNodeRef node) {
    for (; node; node = node.GetParentNode())
        if (pxr::PcpIsInheritArc(node.GetArcType()) && !node.IsDueToAncestor()) return true;
    return false;
}

}  // namespace

void mapPaths(VtValue& value, const PathMapper& mapPath) {
    const bool done =
        changeEach<SdfPathExpression>(value, [&](auto& one) { one = mapExpression(one, mapPath); });
    if (done) return;
    changeHeld<VtDictionary>(value, [&](VtDictionary& dictionary) {
        for (auto& [key, inner] : dictionary) mapPaths(inner, mapPath);
    });
}

bool isPrivateField(const TfToken& field) {
    static const std::set<TfToken> structure = {
        SdfFieldKeys->InheritPaths,    SdfFieldKeys->LayerRelocates,
        SdfFieldKeys->Payload,         SdfFieldKeys->References,
        SdfFieldKeys->Specializes,     SdfFieldKeys->SubLayers,
        SdfFieldKeys->SubLayerOffsets, SdfFieldKeys->VariantSelection,
        SdfFieldKeys->VariantSetNames, SdfFieldKeys->Default,
        SdfFieldKeys->TimeSamples,     SdfFieldKeys->Clips,
        SdfFieldKeys->ClipSets};
    if (structure.contains(field)) return true;
    const auto* definition = pxr::SdfSchema::GetInstance().GetFieldDefinition(field);
    return definition && (definition->IsReadOnly() || definition->HoldsChildren());
}

bool addWeaker(VtValue& result, const Site& site, const TfToken& field, const PathMapper& mapPath,
               AssetPaths assetPaths) {
    VtValue value;
    if (!site.layer->HasField(site.path, field, &value)) return true;
    value = toStage(value, {site.node, site.layerIndex, site.path}, assetPaths);
    if (mapPath) mapPaths(value, mapPath);
    result = result.IsEmpty() ? std::move(value) : mergedOver(std::move(result), value);
    return mergesWeaker(result);
}

VtValue composeField(const PcpPrimIndex& index, const TfToken& property, const TfToken& field,
                     const PathMapper& mapPath, AssetPaths assetPaths) {
    VtValue result;
    forEachSite(index, property, [&](const Site& site) {
        return addWeaker(result, site, field, mapPath, assetPaths);
    });
    applyListOps<pxr::SdfIntListOp, pxr::SdfInt64ListOp, pxr::SdfUIntListOp, pxr::SdfUInt64ListOp,
                 pxr::SdfStringListOp, pxr::SdfTokenListOp>(result, index, property, field);
    return result;
}

pxr::SdfSpecifier composeSpecifier(const PcpPrimIndex& index) {
    auto result = pxr::SdfSpecifierOver;
    forEachSite(index, TfToken(), [&](const Site& site) {
        auto specifier = pxr::SdfSpecifierOver;
        if (!site.layer->HasField(site.path, SdfFieldKeys->Specifier, &specifier) ||
            specifier == pxr::SdfSpecifierOver)
            return true;
        result = specifier;
        return specifier == pxr::SdfSpecifierClass && isInherited(site.node);
    });
    return result;
}

TfToken composeTypeName(const PcpPrimIndex& index) {
    TfToken result;
    forEachSite(index, TfToken(), [&](const Site& site) {
        TfToken type;
        if (!site.layer->HasField(site.path, SdfFieldKeys->TypeName, &type)) return true;
        if (type.IsEmpty() || type == pxr::SdfTokens->AnyTypeToken) return true;
        result = type;
        return false;
    });
    return result;
}

pxr::TfTokenVector composeApiSchemas(const PcpPrimIndex& index) {
    static const TfToken field("apiSchemas");
    std::vector<pxr::SdfTokenListOp> operations;
    forEachSite(index, TfToken(), [&](const Site& site) {
        pxr::SdfTokenListOp operation;
        if (!site.layer->HasField(site.path, field, &operation)) return true;
        operations.push_back(std::move(operation));
        return !operations.back().IsExplicit();
    });
    pxr::TfTokenVector schemas;
    for (const auto& operation : std::views::reverse(operations))
        operation.ApplyOperations(&schemas);
    return schemas;
}

}  // namespace usdlive::stage
