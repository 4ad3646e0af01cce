#pragma once

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace usdlive::layers {

/// What Kit keeps in a layer's customLayerData under `omni_layer`. Keys hold paths with colons, so
/// entries are read and written as the dictionaries they are and not by key paths.
[[nodiscard]] pxr::VtDictionary omniDictionary(const pxr::SdfLayerHandle& layer,
                                               const std::string& name);
/// An empty dictionary removes it. False: the layer takes no edits, or has something else there.
bool setOmniDictionary(const pxr::SdfLayerHandle& layer, const std::string& name,
                       pxr::VtDictionary value);
[[nodiscard]] pxr::VtValue omniValue(const pxr::SdfLayerHandle& layer, const std::string& name);
bool setOmniValue(const pxr::SdfLayerHandle& layer, const std::string& name, pxr::VtValue value);

/// Flags of layers in a root layer, `muteness` and `locked`: {path relative to it: flag}, here by
/// identifier. A key that means the same layer is used again.
[[nodiscard]] std::map<std::string, bool> layerFlags(const pxr::SdfLayerHandle& root,
                                                     const std::string& name);
bool setLayerFlags(const pxr::SdfLayerHandle& root, const std::string& name,
                   const std::map<std::string, bool>& flags);
bool removeLayerFlag(const pxr::SdfLayerHandle& root, const std::string& name,
                     const std::string& identifier);

/// Is the layer locked by its own data, or by the root layer's flags? The root layer never is.
[[nodiscard]] bool isLayerLocked(const pxr::SdfLayerHandle& layer, const pxr::SdfLayerHandle& root);
[[nodiscard]] bool hasOwnLock(const pxr::SdfLayerHandle& layer);
/// Locks the layer in its own data.
bool setOwnLock(const pxr::SdfLayerHandle& layer);

/// The layer that Kit makes the edit target when the root layer is opened; empty: none is named.
[[nodiscard]] std::string authoringLayer(const pxr::SdfLayerHandle& root);
bool setAuthoringLayer(const pxr::SdfLayerHandle& root, const std::string& identifier);

/// `path` as the root layer would name it, and back. Without a root layer the path stays as it is.
[[nodiscard]] std::string relativeTo(const pxr::SdfLayerHandle& root,
                                     const std::string& identifier);
[[nodiscard]] std::string absoluteFrom(const pxr::SdfLayerHandle& root, const std::string& path);
/// The same for a path that was read from customLayerData. Kit writes such paths percent-encoded: a
/// path that names no file as it stands and one when decoded means the decoded file.
[[nodiscard]] std::string storedLayer(const pxr::SdfLayerHandle& root, const std::string& path);

/// Renames the layers that the dictionaries of this file name: flags, links of specs, and the
/// authoring layer. Called for content that moves to another folder.
void renameStoredLayers(const pxr::SdfLayerHandle& layer,
                        const std::function<std::string(const std::string&)>& rename);
/// Decodes percent-encoded characters.
[[nodiscard]] std::string unquoted(const std::string& text);

}  // namespace usdlive::layers
