// Converts values between the times of layers and combines list ops.
#include "usd/content/MappedValue.h"

#include <pxr/base/ts/spline.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/timeCode.h>
#include <pxr/usd/sdf/types.h>

#include <algorithm>

namespace usdlive::content {

using pxr::SdfLayerOffset;
using pxr::VtValue;

namespace {

VtValue mappedSamples(const pxr::SdfTimeSampleMap& samples, const SdfLayerOffset& times) {
    pxr::SdfTimeSampleMap result;
    for (const auto& [time, value] : samples) result[times * time] = mapped(value, times);
    return VtValue::Take(result);
}

VtValue mappedCodes(pxr::VtArray<pxr::SdfTimeCode> codes, const SdfLayerOffset& times) {
    for (auto& code : codes) code = times * code;
    return VtValue::Take(codes);
}

VtValue mappedDictionary(pxr::VtDictionary dictionary, const SdfLayerOffset& times) {
    for (auto& [key, value] : dictionary) value = mapped(value, times);
    return VtValue::Take(dictionary);
}

template <class Arc>
VtValue mappedArcs(pxr::SdfListOp<Arc> arcs, const SdfLayerOffset& times) {
    arcs.ModifyOperations([&](const Arc& arc) {
        Arc result = arc;
        result.SetLayerOffset(times * arc.GetLayerOffset());
        return std::optional<Arc>(result);
    });
    return VtValue::Take(arcs);
}

template <class Arc>
bool hasAssetPath(const pxr::SdfListOp<Arc>& arcs) {
    bool found = false;
    for (const auto type :
         {pxr::SdfListOpTypeExplicit, pxr::SdfListOpTypeAdded, pxr::SdfListOpTypePrepended,
          pxr::SdfListOpTypeAppended, pxr::SdfListOpTypeDeleted, pxr::SdfListOpTypeOrdered})
        for (const Arc& arc : arcs.GetItems(type)) found = found || !arc.GetAssetPath().empty();
    return found;
}

// Looks at one sample, because all have the attribute's type.
bool hasAssetPath(const pxr::SdfTimeSampleMap& samples) {
    for (const auto& [time, value] : samples)
        if (!value.IsHolding<pxr::SdfValueBlock>()) return content::hasAssetPath(value);
    return false;
}

VtValue mappedSpline(pxr::TsSpline spline, const SdfLayerOffset& times) {
    pxr::Ts_SplineOffsetAccess::ApplyOffsetAndScale(&spline, times.GetOffset(), times.GetScale());
    return VtValue::Take(spline);
}

// Used if Sdf has no single equivalent op (added and ordered items, in old files): keeps the weaker
// op's items that the stronger one does not mention.
template <class Op>
Op composedLoosely(const Op& stronger, const Op& weaker) {
    Op result = weaker;
    using pxr::SdfListOpType;
    for (const auto type : {pxr::SdfListOpTypeAdded, pxr::SdfListOpTypePrepended,
                            pxr::SdfListOpTypeAppended, pxr::SdfListOpTypeDeleted}) {
        auto items = result.GetItems(type);
        std::erase_if(items, [&](const auto& item) { return stronger.HasItem(item); });
        const auto& mine = stronger.GetItems(type);
        const bool inFront = type == pxr::SdfListOpTypePrepended;
        items.insert(inFront ? items.begin() : items.end(), mine.begin(), mine.end());
        result.SetItems(items, type);
    }
    if (!stronger.GetOrderedItems().empty()) result.SetOrderedItems(stronger.GetOrderedItems());
    return result;
}

template <class Op>
bool compose(const VtValue& stronger, const VtValue& weaker, VtValue& result) {
    if (!stronger.IsHolding<Op>()) return false;
    const Op& over = stronger.UncheckedGet<Op>();
    if (!weaker.IsHolding<Op>()) {
        result = stronger;
        return true;
    }
    const Op& under = weaker.UncheckedGet<Op>();
    if (const auto both = over.ApplyOperations(under))
        result = *both;
    else
        result = composedLoosely(over, under);
    return true;
}

template <class... Ops>
struct ListOps {
    static bool holds(const VtValue& value) { return (value.IsHolding<Ops>() || ...); }
    static VtValue compose(const VtValue& stronger, const VtValue& weaker) {
        VtValue result;
        (void)(content::compose<Ops>(stronger, weaker, result) || ...);
        return result;
    }
};
using All =
    ListOps<pxr::SdfTokenListOp, pxr::SdfPathListOp, pxr::SdfReferenceListOp, pxr::SdfPayloadListOp,
            pxr::SdfStringListOp, pxr::SdfIntListOp, pxr::SdfUIntListOp, pxr::SdfInt64ListOp,
            pxr::SdfUInt64ListOp, pxr::SdfUnregisteredValueListOp>;

}  // namespace

VtValue mapped(const VtValue& value, const SdfLayerOffset& times) {
    if (times.IsIdentity() || value.IsEmpty()) return value;
    if (value.IsHolding<double>()) return value;
    if (value.IsHolding<pxr::SdfTimeCode>())
        return VtValue(times * value.UncheckedGet<pxr::SdfTimeCode>());
    if (value.IsHolding<pxr::VtArray<pxr::SdfTimeCode>>())
        return mappedCodes(value.UncheckedGet<pxr::VtArray<pxr::SdfTimeCode>>(), times);
    if (value.IsHolding<pxr::SdfTimeSampleMap>())
        return mappedSamples(value.UncheckedGet<pxr::SdfTimeSampleMap>(), times);
    if (value.IsHolding<pxr::VtDictionary>())
        return mappedDictionary(value.UncheckedGet<pxr::VtDictionary>(), times);
    if (value.IsHolding<pxr::SdfReferenceListOp>())
        return mappedArcs(value.UncheckedGet<pxr::SdfReferenceListOp>(), times);
    if (value.IsHolding<pxr::SdfPayloadListOp>())
        return mappedArcs(value.UncheckedGet<pxr::SdfPayloadListOp>(), times);
    if (value.IsHolding<pxr::TsSpline>())
        return mappedSpline(value.UncheckedGet<pxr::TsSpline>(), times);
    return value;
}

bool hasAssetPath(const VtValue& value) {
    if (value.IsHolding<pxr::SdfAssetPath>() || value.IsHolding<pxr::VtArray<pxr::SdfAssetPath>>())
        return true;
    if (value.IsHolding<pxr::SdfTimeSampleMap>())
        return hasAssetPath(value.UncheckedGet<pxr::SdfTimeSampleMap>());
    if (value.IsHolding<pxr::SdfReferenceListOp>())
        return hasAssetPath(value.UncheckedGet<pxr::SdfReferenceListOp>());
    if (value.IsHolding<pxr::SdfPayloadListOp>())
        return hasAssetPath(value.UncheckedGet<pxr::SdfPayloadListOp>());
    return false;
}

VtValue composedListOp(const VtValue& stronger, const VtValue& weaker) {
    return All::compose(stronger, weaker);
}

bool isListOp(const VtValue& value) { return All::holds(value); }

}  // namespace usdlive::content
