// Reads and writes Kit's data in a layer's customLayerData.
#include "usd/layers/OmniLayerData.h"

#include <pxr/base/vt/types.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/schema.h>

#include <cctype>
#include <filesystem>
#include <string_view>

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

bool isThere(const std::string& identifier) {
    std::error_code ignored;
    return pxr::SdfLayer::Find(identifier) || std::filesystem::exists(identifier, ignored) ||
           (isAddress(identifier) && pxr::ArGetResolver().Resolve(identifier));
}

// Returns the part before the path, such as `usdlive://localhost:7447`.
std::string_view serverOf(std::string_view address) {
    return address.substr(0, address.find('/', std::string_view("usdlive://").size()));
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

std::string unquoted(const std::string& text) {
    std::string result;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const bool escape = text[i] == '%' && i + 2 < text.size() &&
                            std::isxdigit(static_cast<unsigned char>(text[i + 1])) &&
                            std::isxdigit(static_cast<unsigned char>(text[i + 2]));
        if (escape) {
            result += char(std::stoi(text.substr(i + 1, 2), nullptr, 16));
            i += 2;
        } else {
            result += text[i];
        }
    }
    return result;
}

std::string absoluteFrom(const pxr::SdfLayerHandle& root, const std::string& path) {
    if (!root || path.empty() || pxr::SdfLayer::IsAnonymousLayerIdentifier(path)) return path;
    const std::string plain = LayerUtils::withoutFileScheme(path);
    return LayerUtils::normalizeUrl(pxr::SdfComputeAssetPathRelativeToLayer(root, plain));
}

std::string relativeTo(const pxr::SdfLayerHandle& root, const std::string& identifier) {
    namespace fs = std::filesystem;
    if (!root || root->IsAnonymous()) return identifier;
    const fs::path from(root->GetRealPath()), to(identifier);
    const bool areOfOneServer = isAddress(identifier) && isAddress(root->GetRealPath()) &&
                                serverOf(identifier) == serverOf(root->GetRealPath());
    if (from.empty() || (!to.is_absolute() && !areOfOneServer)) return identifier;
    const auto relative = to.lexically_relative(from.parent_path()).generic_string();
    if (relative.empty()) return identifier;
    return relative.starts_with("..") ? relative : "./" + relative;
}

std::string storedLayer(const pxr::SdfLayerHandle& root, const std::string& path) {
    auto plain = absoluteFrom(root, path);
    if (path.find('%') == std::string::npos || isThere(plain)) return plain;
    auto decoded = absoluteFrom(root, unquoted(path));
    return isThere(decoded) ? decoded : plain;
}

std::map<std::string, bool> layerFlags(const pxr::SdfLayerHandle& root, const std::string& name) {
    std::map<std::string, bool> flags;
    for (const auto& [path, flag] : omniDictionary(root, name))
        flags[storedLayer(root, path)] = flag.GetWithDefault<bool>(false);
    return flags;
}

bool setLayerFlags(const pxr::SdfLayerHandle& root, const std::string& name,
                   const std::map<std::string, bool>& flags) {
    VtDictionary stored = omniDictionary(root, name);
    const VtDictionary before = stored;
    std::map<std::string, std::string> keys;
    for (const auto& [path, flag] : stored) keys.emplace(storedLayer(root, path), path);
    for (const auto& [identifier, flag] : flags) {
        if (identifier.empty()) return false;
        const auto known = keys.find(absoluteFrom(root, identifier));
        if (!flag && known == keys.end()) continue;  // a missing flag means the same
        stored[known == keys.end() ? relativeTo(root, identifier) : known->second] = VtValue(flag);
    }
    return stored == before || setOmniDictionary(root, name, std::move(stored));
}

bool removeLayerFlag(const pxr::SdfLayerHandle& root, const std::string& name,
                     const std::string& identifier) {
    VtDictionary stored = omniDictionary(root, name), left;
    for (const auto& [path, flag] : stored)
        if (storedLayer(root, path) != absoluteFrom(root, identifier)) left[path] = flag;
    return left.size() != stored.size() && setOmniDictionary(root, name, std::move(left));
}

bool hasOwnLock(const pxr::SdfLayerHandle& layer) {
    return omniValue(layer, "locked").GetWithDefault<bool>(false);
}

bool setOwnLock(const pxr::SdfLayerHandle& layer) {
    return setOmniValue(layer, "locked", VtValue(true));
}

bool isLayerLocked(const pxr::SdfLayerHandle& layer, const pxr::SdfLayerHandle& root) {
    if (!layer || layer == root) return false;
    if (hasOwnLock(layer)) return true;
    const auto flags = layerFlags(root, "locked");
    const auto flag = flags.find(layer->GetIdentifier());
    return flag != flags.end() && flag->second;
}

std::string authoringLayer(const pxr::SdfLayerHandle& root) {
    return storedLayer(root, omniValue(root, "authoring_layer").GetWithDefault<std::string>());
}

bool setAuthoringLayer(const pxr::SdfLayerHandle& root, const std::string& identifier) {
    return setOmniValue(root, "authoring_layer", VtValue(relativeTo(root, identifier)));
}

void renameStoredLayers(const pxr::SdfLayerHandle& layer,
                        const std::function<std::string(const std::string&)>& rename) {
    for (const char* name : {"muteness", "locked"}) {
        VtDictionary renamed;
        for (const auto& [path, flag] : omniDictionary(layer, name)) renamed[rename(path)] = flag;
        if (!renamed.empty()) setOmniDictionary(layer, name, std::move(renamed));
    }
    VtDictionary links = omniDictionary(layer, "specs_linking");
    for (auto& [spec, value] : links) {
        if (!value.IsHolding<pxr::VtStringArray>()) continue;
        auto layers = value.UncheckedGet<pxr::VtStringArray>();
        for (auto& one : layers) one = rename(one);
        value = VtValue::Take(layers);
    }
    if (!links.empty()) setOmniDictionary(layer, "specs_linking", std::move(links));
    const VtValue authoring = omniValue(layer, "authoring_layer");
    if (authoring.IsHolding<std::string>())
        setOmniValue(layer, "authoring_layer", VtValue(rename(authoring.Get<std::string>())));
}

}  // namespace usdlive::layers
