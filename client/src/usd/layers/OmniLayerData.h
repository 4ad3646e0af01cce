// Kit's data in a layer's customLayerData.
#pragma once

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/layer.h>

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace usdlive::layers {

/// Reads and writes Kit's data under `omni_layer` in a layer's customLayerData. Its keys are paths
/// that may contain colons, so entries are handled as dictionaries and not by key paths.
[[nodiscard]] pxr::VtDictionary omniDictionary(const pxr::SdfLayerHandle& layer,
                                               const std::string& name);
/// An empty dictionary removes the entry. Returns false if the layer accepts no edits or has other
/// data there.
bool setOmniDictionary(const pxr::SdfLayerHandle& layer, const std::string& name,
                       pxr::VtDictionary value);
[[nodiscard]] pxr::VtValue omniValue(const pxr::SdfLayerHandle& layer, const std::string& name);
bool setOmniValue(const pxr::SdfLayerHandle& layer, const std::string& name, pxr::VtValue value);

/// The flags of layers in a root layer, `muteness` and `locked`: stored as {path relative to the
/// root: flag}, returned by identifier. Writing uses an existing key for the same layer.
[[nodiscard]] std::map<std::string, bool> layerFlags(const pxr::SdfLayerHandle& root,
                                                     const std::string& name);
bool setLayerFlags(const pxr::SdfLayerHandle& root, const std::string& name,
                   const std::map<std::string, bool>& flags);
bool removeLayerFlag(const pxr::SdfLayerHandle& root, const std::string& name,
                     const std::string& identifier);

/// Returns true if the layer is locked by its own data or by the root layer's flags. The root layer
/// is never locked.
[[nodiscard]] bool isLayerLocked(const pxr::SdfLayerHandle& layer, const pxr::SdfLayerHandle& root);
[[nodiscard]] bool hasOwnLock(const pxr::SdfLayerHandle& layer);
/// Locks the layer in its own data.
bool setOwnLock(const pxr::SdfLayerHandle& layer);

/// Returns the layer that Kit makes the edit target when it opens the root layer, or an empty text.
[[nodiscard]] std::string authoringLayer(const pxr::SdfLayerHandle& root);
bool setAuthoringLayer(const pxr::SdfLayerHandle& root, const std::string& identifier);

/// Returns true for the address of a file in a served project.
[[nodiscard]] inline bool isAddress(const std::string& path) {
    return path.starts_with("usdlive://");
}

/// Convert between an identifier and the path that the root layer would write. Without a root layer
/// the path stays unchanged.
[[nodiscard]] std::string relativeTo(const pxr::SdfLayerHandle& root,
                                     const std::string& identifier);
[[nodiscard]] std::string absoluteFrom(const pxr::SdfLayerHandle& root, const std::string& path);
/// Does the same for a path read from customLayerData. Kit writes such paths percent-encoded: if
/// the path names no file but its decoded form does, the decoded form is used.
[[nodiscard]] std::string storedLayer(const pxr::SdfLayerHandle& root, const std::string& path);

/// Renames the layers in the dictionaries of this header: flags, links of specs, and the authoring
/// layer. Called for content that moves to another folder.
void renameStoredLayers(const pxr::SdfLayerHandle& layer,
                        const std::function<std::string(const std::string&)>& rename);
/// Decodes percent-encoded characters.
[[nodiscard]] std::string unquoted(const std::string& text);

}  // namespace usdlive::layers
