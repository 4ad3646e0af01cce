// Edits of a layer's content that keep what others do beside them: each writes only what differs,
// so a live layer sends only that. (SdfLayer::TransferContent writes past a layer's delegate.)
#pragma once

#include <pxr/base/tf/token.h>
#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/path.h>

#include <set>
#include <utility>
#include <vector>

namespace usdlive::content {

/// The paths of all specs at `root` and below, parents first and siblings in reverse order; none
/// when there is no spec at `root`.
[[nodiscard]] std::vector<pxr::SdfPath> pathsBelow(const pxr::SdfLayerHandle& layer,
                                                   const pxr::SdfPath& root);
/// The path of the spec that lists this one as its child. A variant is a child of its variant set,
/// whose path is `/Prim{set=}`.
[[nodiscard]] pxr::SdfPath ownerOf(const pxr::SdfPath& path);

/// The names of the prims below a prim, a variant or the pseudo-root, in order.
[[nodiscard]] pxr::TfTokenVector primChildren(const pxr::SdfLayerHandle& layer,
                                              const pxr::SdfPath& parent);
/// Moves each of `names` that is there behind the siblings that it follows in `order`.
void arrange(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& parent,
             const pxr::TfTokenVector& order, const std::set<pxr::TfToken>& names);

/// Makes the content at `root` and below like that of `wanted`, in one change block.
void makeLike(const pxr::SdfLayerHandle& layer, const pxr::SdfLayerHandle& wanted,
              const pxr::SdfPath& root = pxr::SdfPath::AbsoluteRootPath());
/// Gives `content` the layer metadata of `layer`, but keeps its own sublayers.
void takeMetadata(const pxr::SdfLayerHandle& content, const pxr::SdfLayerHandle& layer);

/// Old paths and the new ones that replace them.
using Moves = std::vector<std::pair<pxr::SdfPath, pxr::SdfPath>>;
/// Makes targets, connections and arcs within the layer that lead to (below) an old path lead to
/// the new one.
void retarget(const pxr::SdfLayerHandle& layer, const Moves& moves);

}  // namespace usdlive::content
