#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace usdlive::layers {

/// What one does with layers and sublayers, as Kit's LayerUtils. Nothing throws: null, empty or
/// false where it cannot be done.
namespace LayerUtils {

/// A new layer (an existing file is emptied; an empty identifier makes an anonymous one) as
/// sublayer of `layer` before `position`; -1 and past the end: last.
pxr::SdfLayerRefPtr createSublayer(const pxr::SdfLayerHandle& layer, int position,
                                   const std::string& identifier);
/// An existing one. Null where it cannot be opened, is there already, or would contain itself.
pxr::SdfLayerRefPtr insertSublayer(const pxr::SdfLayerHandle& layer, int position,
                                   const std::string& identifier, bool checkEmptyLayer = true);
pxr::SdfLayerRefPtr replaceSublayer(const pxr::SdfLayerHandle& layer, int position,
                                    const std::string& identifier);
/// Its identifier; empty where there is none at the position.
std::string removeSublayer(const pxr::SdfLayerHandle& layer, int position);
bool moveLayer(const pxr::SdfLayerHandle& fromParent, int fromPosition,
               const pxr::SdfLayerHandle& toParent, int toPosition, bool removeSource = false);

[[nodiscard]] std::string sublayerIdentifier(const pxr::SdfLayerHandle& layer, int position);
[[nodiscard]] int sublayerPosition(const pxr::SdfLayerHandle& layer, const std::string& identifier);
/// Sublayers of the tree below `layer`, strong to weak, each once; also muted and missing ones.
[[nodiscard]] std::vector<std::string> allSublayers(const pxr::SdfLayerHandle& layer);
/// Layers of the tree, `layer` itself among them, that are loaded and have edits which are not
/// saved; without anonymous ones.
[[nodiscard]] std::vector<std::string> localDirtyLayers(const pxr::SdfLayerHandle& layer);
[[nodiscard]] bool hasDirtyLayers(const pxr::SdfLayerHandle& layer);
/// Calls `visit(parent, position, identifier, layer)` (the layer is null where it cannot be opened)
/// until it returns false. Sublayers that contain themselves are visited once.
void iterateSublayers(const pxr::SdfLayerHandle& layer,
                      const std::function<bool(const pxr::SdfLayerHandle& parent, int position,
                                               const std::string& identifier,
                                               const pxr::SdfLayerHandle& layer)>& visit);
[[nodiscard]] bool isInSublayerTree(const pxr::SdfLayerHandle& layer,
                                    const std::string& identifier);

[[nodiscard]] bool hasPrimSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
bool removePrimSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
[[nodiscard]] bool hasRootPrimSpecs(const pxr::SdfLayerHandle& layer);

/// Calls `visit` for the prim specs below `path` (and for its own), parents before children, also
/// within variants, until it returns false. `visit` does not change what is there.
void iteratePrimSpecs(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                      const std::function<bool(const pxr::SdfPrimSpecHandle& spec)>& visit);

bool transferContent(const pxr::SdfLayerHandle& from, const pxr::SdfLayerHandle& to,
                     bool copyCustomData = true, bool skipSublayers = true);
/// Asset paths of `target` that are relative to `base` become relative to the target, or to the
/// base, or absolute.
void resolvePaths(const pxr::SdfLayerHandle& base, const pxr::SdfLayerHandle& target,
                  bool storeRelativePath = true, bool relativeToBaseLayer = false,
                  bool copySublayerOffsets = false);

[[nodiscard]] std::string customLayerName(const pxr::SdfLayerHandle& layer);
bool setCustomLayerName(const pxr::SdfLayerHandle& layer, const std::string& name);

/// All in one notice.
bool reloadLayers(const std::vector<std::string>& identifiers);
/// True when all were saved; `failed` gets the others.
bool saveLayers(const std::vector<std::string>& identifiers,
                std::vector<std::string>* failed = nullptr);

/// A path or URL without `.` and `..`, and with `/` for `\`. `file:///path` becomes the path.
[[nodiscard]] std::string normalizeUrl(const std::string& url);
/// The decoded path of a `file://` URL; anything else is returned as it is.
[[nodiscard]] std::string withoutFileScheme(const std::string& url);
/// Changes the layers that are named in a layer's customLayerData (flags, links, authoring layer)
/// for content that moves from one folder to another.
void reanchorStates(const pxr::SdfLayerHandle& content, const std::string& fromFolder,
                    const std::string& toFolder);

}  // namespace LayerUtils

}  // namespace usdlive::layers
