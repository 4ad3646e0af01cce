// Operations on layers and sublayers, as in Kit's LayerUtils.
#pragma once

#include <pxr/usd/sdf/layer.h>
#include <pxr/usd/sdf/primSpec.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace usdlive::layers {

/// Operations on layers and sublayers, as in Kit's LayerUtils. No function throws; a failure
/// returns null, empty or false.
namespace LayerUtils {

/// Creates a layer and inserts it as sublayer of `layer` before `position`; -1 and positions past
/// the end mean last. An existing file is emptied; an empty identifier creates an anonymous layer.
pxr::SdfLayerRefPtr createSublayer(const pxr::SdfLayerHandle& layer, int position,
                                   const std::string& identifier);
/// Inserts an existing layer. Returns null if it cannot be opened, is a sublayer already, or would
/// contain itself.
pxr::SdfLayerRefPtr insertSublayer(const pxr::SdfLayerHandle& layer, int position,
                                   const std::string& identifier, bool checkEmptyLayer = true);
pxr::SdfLayerRefPtr replaceSublayer(const pxr::SdfLayerHandle& layer, int position,
                                    const std::string& identifier);
/// Returns the identifier of the removed sublayer, or an empty text if there is none at the
/// position.
std::string removeSublayer(const pxr::SdfLayerHandle& layer, int position);
bool moveLayer(const pxr::SdfLayerHandle& fromParent, int fromPosition,
               const pxr::SdfLayerHandle& toParent, int toPosition, bool removeSource = false);

[[nodiscard]] std::string sublayerIdentifier(const pxr::SdfLayerHandle& layer, int position);
[[nodiscard]] int sublayerPosition(const pxr::SdfLayerHandle& layer, const std::string& identifier);
/// Returns the sublayers of the tree below `layer`, strong to weak, each once, including muted and
/// missing ones.
[[nodiscard]] std::vector<std::string> allSublayers(const pxr::SdfLayerHandle& layer);
/// Returns the loaded layers of the tree, including `layer`, that have unsaved edits. Skips
/// anonymous layers.
[[nodiscard]] std::vector<std::string> localDirtyLayers(const pxr::SdfLayerHandle& layer);
[[nodiscard]] bool hasDirtyLayers(const pxr::SdfLayerHandle& layer);
/// Calls `visit(parent, position, identifier, layer)` until it returns false. `layer` is null if it
/// cannot be opened. A sublayer that contains itself is visited once.
void iterateSublayers(const pxr::SdfLayerHandle& layer,
                      const std::function<bool(const pxr::SdfLayerHandle& parent, int position,
                                               const std::string& identifier,
                                               const pxr::SdfLayerHandle& layer)>& visit);
[[nodiscard]] bool isInSublayerTree(const pxr::SdfLayerHandle& layer,
                                    const std::string& identifier);

[[nodiscard]] bool hasPrimSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
bool removePrimSpec(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path);
[[nodiscard]] bool hasRootPrimSpecs(const pxr::SdfLayerHandle& layer);

/// Calls `visit` for the prim specs at and below `path`, parents before children, including
/// variants, until it returns false. `visit` must not change the specs.
void iteratePrimSpecs(const pxr::SdfLayerHandle& layer, const pxr::SdfPath& path,
                      const std::function<bool(const pxr::SdfPrimSpecHandle& spec)>& visit);

bool transferContent(const pxr::SdfLayerHandle& from, const pxr::SdfLayerHandle& to,
                     bool copyCustomData = true, bool skipSublayers = true);
/// Changes asset paths in `target` that are relative to `base`: relative to the target, relative to
/// the base, or absolute.
void resolvePaths(const pxr::SdfLayerHandle& base, const pxr::SdfLayerHandle& target,
                  bool storeRelativePath = true, bool relativeToBaseLayer = false,
                  bool copySublayerOffsets = false);

[[nodiscard]] std::string customLayerName(const pxr::SdfLayerHandle& layer);
bool setCustomLayerName(const pxr::SdfLayerHandle& layer, const std::string& name);

/// Reloads all layers with one notice.
bool reloadLayers(const std::vector<std::string>& identifiers);
/// Returns true if all were saved; `failed` receives the others.
bool saveLayers(const std::vector<std::string>& identifiers,
                std::vector<std::string>* failed = nullptr);

/// Returns the path or URL without `.` and `..`, and with `/` instead of `\`. `file:///path`
/// becomes the path.
[[nodiscard]] std::string normalizeUrl(const std::string& url);
/// Returns the decoded path of a `file://` URL, and any other text unchanged.
[[nodiscard]] std::string withoutFileScheme(const std::string& url);
/// Changes the names of layers in a layer's customLayerData (flags, links, authoring layer) for
/// content that moves from one folder to another.
void reanchorStates(const pxr::SdfLayerHandle& content, const std::string& fromFolder,
                    const std::string& toFolder);

}  // namespace LayerUtils

}  // namespace usdlive::layers
