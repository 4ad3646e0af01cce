#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>

namespace usdlive::content {

/// Makes the spec at `path`, of the kind and type of the one at `from` in `source`, with overs on
/// the way to it. False: it cannot stand there.
bool makeSpecLike(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                  const pxr::SdfLayerHandle& source, const pxr::SdfPath& from);
/// Removes a spec with everything below it; an absent one is no error.
void removeSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
void moveSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& from, const pxr::SdfPath& to);

/// Sets a list op (empty value: erases it) as Sdf's own editors do: targets, connections and
/// variant sets have specs of their own, which come and go with it.
void setListOp(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
               const pxr::TfToken& field, const pxr::VtValue& value);

}  // namespace usdlive::content
