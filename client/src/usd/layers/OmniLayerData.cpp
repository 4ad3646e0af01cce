#include "usdlive/client/usd/layers/OmniLayerData.h"

#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/schema.h>

#include <filesystem>

#include "usdlive/client/usd/layers/LayerUtils.h"

namespace usdlive::layers {

using pxr::VtDictionary;
using pxr::VtValue;

namespace {

const std::string kGroup = "omni_layer";

VtDictionary groupOf(const pxr::SdfLayerHandle& layer) {
    if (!layer) return {};
    const VtDictionary data = layer->GetCustomLayerData();
    const auto found = data.find(kGroup);
    if (found == data.end() || !found->second.IsHolding<VtDictionary>()) return {};
    return found->second.UncheckedGet<VtDictionary>();
}

}  // namespace

VtValue omniValue(const pxr::SdfLayerHandle& layer, const std::string& name) {
    const VtDictionary group = groupOf(layer);
    const auto found = group.find(name);
    return found == group.end() ? VtValue() : found->second;
}

VtDictionary omniDictionary(const pxr::SdfLayerHandle& layer, const std::string& name) {
    return omniValue(layer, name).GetWithDefault<VtDictionary>();
}

bool setOmniValue(const pxr::SdfLayerHandle& layer, const std::string& name, VtValue value) {
    if (!layer) return false;
    VtDictionary group = groupOf(layer);
    const auto before = group;
    if (value.IsEmpty())
        group.erase(name);
    else
        group[name] = std::move(value);
    if (group == before) return true;
    if (!layer->PermissionToEdit()) return false;
    VtDictionary data = layer->GetCustomLayerData();
    if (group.empty())
        data.erase(kGroup);
    else
        data[kGroup] = VtValue::Take(group);
    layer->SetCustomLayerData(data);
    return true;
}

bool setOmniDictionary(const pxr::SdfLayerHandle& layer, const std::string& name,
                       VtDictionary value) {
    const VtValue present = omniValue(layer, name);
    if (!present.IsEmpty() && !present.IsHolding<VtDictionary>()) return false;
    return setOmniValue(layer, name, value.empty() ? VtValue() : VtValue::Take(value));
}

std::string absoluteFrom(const pxr::SdfLayerHandle& root, const std::string& path) {
    if (path.empty() || pxr::SdfLayer::IsAnonymousLayerIdentifier(path)) return path;
    return LayerUtils::normalizeUrl(pxr::SdfComputeAssetPathRelativeToLayer(root, path));
}

std::string relativeTo(const pxr::SdfLayerHandle& root, const std::string& identifier) {
    namespace fs = std::filesystem;
    const fs::path from(root->GetRealPath()), to(identifier);
    if (root->IsAnonymous() || from.empty() || !to.is_absolute()) return identifier;
    const auto relative = to.lexically_relative(from.parent_path()).generic_string();
    if (relative.empty()) return identifier;
    return relative.starts_with("..") ? relative : "./" + relative;
}

std::map<std::string, bool> layerFlags(const pxr::SdfLayerHandle& root, const std::string& name) {
    std::map<std::string, bool> flags;
    for (const auto& [path, flag] : omniDictionary(root, name))
        flags[absoluteFrom(root, path)] = flag.GetWithDefault<bool>(false);
    return flags;
}

bool setLayerFlags(const pxr::SdfLayerHandle& root, const std::string& name,
                   const std::map<std::string, bool>& flags) {
    VtDictionary stored = omniDictionary(root, name);
    std::map<std::string, std::string> keys;
    for (const auto& [path, flag] : stored) keys.emplace(absoluteFrom(root, path), path);
    for (const auto& [identifier, flag] : flags) {
        const auto known = keys.find(absoluteFrom(root, identifier));
        stored[known == keys.end() ? relativeTo(root, identifier) : known->second] = VtValue(flag);
    }
    return setOmniDictionary(root, name, std::move(stored));
}

bool removeLayerFlag(const pxr::SdfLayerHandle& root, const std::string& name,
                     const std::string& identifier) {
    VtDictionary stored = omniDictionary(root, name), left;
    for (const auto& [path, flag] : stored)
        if (absoluteFrom(root, path) != absoluteFrom(root, identifier)) left[path] = flag;
    return left.size() != stored.size() && setOmniDictionary(root, name, std::move(left));
}

}  // namespace usdlive::layers
