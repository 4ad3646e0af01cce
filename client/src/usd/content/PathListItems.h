// Visits all items of a list op.
#pragma once

#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/path.h>

namespace usdlive::content {

/// Calls `visit` for each item of a list, also for deleted and ordered ones.
template <class Item, class Visit>
void forEachItem(const pxr::SdfListOp<Item>& list, Visit&& visit) {
    for (const auto type :
         {pxr::SdfListOpTypeExplicit, pxr::SdfListOpTypeAdded, pxr::SdfListOpTypePrepended,
          pxr::SdfListOpTypeAppended, pxr::SdfListOpTypeDeleted, pxr::SdfListOpTypeOrdered})
        for (const Item& item : list.GetItems(type)) visit(item);
}

/// Does the same for paths.
template <class Visit>
void forEachPath(const pxr::SdfPathListOp& list, Visit&& visit) {
    forEachItem(list, visit);
}

}  // namespace usdlive::content
