// Edits a layer's content without overwriting concurrent edits: each function writes only
// differences, and a live layer sends only those. (SdfLayer::TransferContent bypasses a layer's
// delegate.)
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <set>
#include <utility>
#include <vector>

namespace usdlive::content {

/// Returns the paths of all specs at and below `root`, parents first and siblings in reverse order.
/// Empty if there is no spec at `root`.
[[nodiscard]] std::vector<pxr::SdfPath> pathsBelow(const pxr::SdfLayerHandle& layer,
                                                   const pxr::SdfPath& root);
/// Returns the path of the spec that lists this one as its child. For a variant this is its variant
/// set, `/Prim{set=}`.
[[nodiscard]] pxr::SdfPath ownerOf(const pxr::SdfPath& path);

/// Returns the names of the prims below a prim, a variant or the pseudo-root, in order.
[[nodiscard]] pxr::TfTokenVector primChildren(const pxr::SdfLayerHandle& layer,
                                              const pxr::SdfPath& parent);
/// Returns `children` with each of those in `names` behind the siblings that precede it in `order`.
[[nodiscard]] pxr::TfTokenVector arranged(const pxr::TfTokenVector& children,
                                          const pxr::TfTokenVector& order,
                                          const std::set<pxr::TfToken>& names);
/// Moves each existing child in `names` behind the siblings that precede it in `order`.
void arrange(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& parent,
             const pxr::TfTokenVector& order, const std::set<pxr::TfToken>& names);

/// Makes the content at and below `root` equal to that of `wanted`, in one change block.
void makeLike(const pxr::SdfLayerHandle& layer, const pxr::SdfLayerHandle& wanted,
              const pxr::SdfPath& root = pxr::SdfPath::AbsoluteRootPath());
/// Copies the layer metadata of `layer` to `content`, which keeps its own sublayers.
void takeMetadata(const pxr::SdfLayerHandle& content, const pxr::SdfLayerHandle& layer);

/// Pairs of old and new paths.
using Moves = std::vector<std::pair<pxr::SdfPath, pxr::SdfPath>>;
/// Replaces old paths in targets, connections and internal arcs of the layer by the new ones, also
/// for paths below them.
void retarget(const pxr::SdfLayerHandle& layer, const Moves& moves);

}  // namespace usdlive::content
