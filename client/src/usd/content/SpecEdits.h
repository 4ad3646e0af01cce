// Creates and removes specs, and sets list ops.
#pragma once

#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <set>

namespace usdlive::content {

/// Creates the spec at `path` with the kind and type of the one at `from` in `source`. Creates
/// missing ancestors as overs. Returns false if the spec is not possible there.
bool makeSpecLike(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                  const pxr::SdfLayerHandle& source, const pxr::SdfPath& from);
/// Removes a spec and everything below it. An absent spec is no error.
void removeSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
/// Removes specs of one owner, which is their parent or variant set, with everything below them.
/// (When Sdf removes prims or properties alone, it copies the names of all siblings for each.)
void removeSpecs(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& owner,
                 const std::set<pxr::SdfPath>& paths);
void moveSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& from, const pxr::SdfPath& to);

/// Sets a list op, or erases it if the value is empty, like Sdf's own editors: specs of targets,
/// connections and variant sets are created and removed with it.
void setListOp(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
               const pxr::TfToken& field, const pxr::VtValue& value);

}  // namespace usdlive::content
