// Visits all paths of a list op.
#pragma once

#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/path.h>

namespace usdlive::content {

/// Calls `visit` for each path of a list, also for deleted and ordered ones.
template <class Visit>
void forEachPath(const pxr::SdfPathListOp& list, Visit&& visit) {
    for (const auto type :
         {pxr::SdfListOpTypeExplicit, pxr::SdfListOpTypeAdded, pxr::SdfListOpTypePrepended,
          pxr::SdfListOpTypeAppended, pxr::SdfListOpTypeDeleted, pxr::SdfListOpTypeOrdered})
        for (const pxr::SdfPath& path : list.GetItems(type)) visit(path);
}

}  // namespace usdlive::content
