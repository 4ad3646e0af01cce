// Undoes changes of lists and list ops item by item.
#include "usd/content/ListMerge.h"

#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>

#include "usdlive/client/usd/content/Registers.h"

namespace usdlive::content {

using pxr::VtValue;

namespace {

// An absent value counts as an empty list or a list op without items.
template <class List>
bool areLists(const VtValue& present, const VtValue& after, const VtValue& before) {
    const auto is = [](const VtValue& value) { return value.IsEmpty() || value.IsHolding<List>(); };
    return (present.IsHolding<List>() || after.IsHolding<List>()) && is(present) && is(after) &&
           is(before);
}

template <class Op>
bool takeBackOp(const VtValue& present, const VtValue& after, const VtValue& before,
                std::optional<VtValue>& result) {
    if (!areLists<Op>(present, after, before)) return false;
    auto op = present.GetWithDefault<Op>();
    const auto now = after.GetWithDefault<Op>(), old = before.GetWithDefault<Op>();
    if (op.IsExplicit() != now.IsExplicit() || now.IsExplicit() != old.IsExplicit()) return true;
    using List = std::vector<pxr::SdfListOpType>;
    for (const auto type :
         op.IsExplicit()
             ? List{pxr::SdfListOpTypeExplicit}
             : List{pxr::SdfListOpTypePrepended, pxr::SdfListOpTypeAppended,
                    pxr::SdfListOpTypeDeleted, pxr::SdfListOpTypeAdded, pxr::SdfListOpTypeOrdered})
        op.SetItems(undoneList(op.GetItems(type), now.GetItems(type), old.GetItems(type)), type);
    result = op.HasKeys() ? VtValue::Take(op) : VtValue();
    return true;
}

template <class... Ops>
std::optional<VtValue> undoneOp(const VtValue& present, const VtValue& after,
                                const VtValue& before) {
    std::optional<VtValue> result;
    (void)(takeBackOp<Ops>(present, after, before, result) || ...);
    return result;
}

}  // namespace

std::optional<VtValue> undoneList(const VtValue& present, const VtValue& after,
                                  const VtValue& before) {
    if (areLists<Sublayers>(present, after, before))
        return VtValue(undoneList(present.GetWithDefault<Sublayers>(),
                                  after.GetWithDefault<Sublayers>(),
                                  before.GetWithDefault<Sublayers>()));
    return undoneOp<pxr::SdfTokenListOp, pxr::SdfPathListOp, pxr::SdfReferenceListOp,
                    pxr::SdfPayloadListOp, pxr::SdfStringListOp, pxr::SdfIntListOp,
                    pxr::SdfUIntListOp, pxr::SdfInt64ListOp, pxr::SdfUInt64ListOp,
                    pxr::SdfUnregisteredValueListOp>(present, after, before);
}

}  // namespace usdlive::content
