#pragma once

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/layer.h>

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

/// `path` as the root layer would name it, and back.
[[nodiscard]] std::string relativeTo(const pxr::SdfLayerHandle& root,
                                     const std::string& identifier);
[[nodiscard]] std::string absoluteFrom(const pxr::SdfLayerHandle& root, const std::string& path);

}  // namespace usdlive::layers
