// Operations on layers and sublayers, as in Kit's LayerUtils.
#include "usdlive/client/usd/layers/LayerUtils.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/ar/resolver.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/layerUtils.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/variantSetSpec.h>
#include <pxr/usd/sdf/variantSpec.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <string_view>
#include <utility>

#include "usd/content/SpecEdits.h"
#include "usd/layers/OmniLayerData.h"
#include "usdlive/common/usd/TfComplaints.h"

namespace usdlive::layers::LayerUtils {

using content::removeSpec;
using pxr::SdfLayerHandle;
using pxr::SdfLayerRefPtr;
using pxr::VtValue;

namespace {

const std::string kCustomName = "custom_name";

// Returns the index for the position, or nothing if it is invalid.
std::optional<std::size_t> placeFor(const SdfLayerHandle& layer, int position) {
    if (!layer || position < -1) return std::nullopt;
    const std::size_t count = layer->GetNumSubLayerPaths();
    return position == -1 ? count : std::min(std::size_t(position), count);
}

bool contains(const SdfLayerHandle& layer, const SdfLayerHandle& other) {
    return layer == other || isInSublayerTree(layer, other->GetIdentifier());
}

SdfLayerRefPtr open(const std::string& identifier) {
    const usd::TfComplaints complaints;
    return pxr::SdfLayer::FindOrOpen(identifier);
}

// Returns the path that the parent uses for the layer.
std::string nameIn(const SdfLayerHandle& parent, const SdfLayerHandle& layer) {
    return relativeTo(parent, layer->GetIdentifier());
}

std::string fileOf(const std::string& path) {
    const auto file = path.substr(0, path.find(":SDF_FORMAT_ARGS:"));
    return file.substr(0, file.find('['));  // the file of a package
}

bool hasDots(const std::string& path) { return path.starts_with("./") || path.starts_with("../"); }

// Returns true if the path is not absolute, an address, in memory, or an expression.
bool isRelative(const std::string& path) {
    if (hasDots(path)) return true;
    return !path.empty() && !path.starts_with('/') && !path.starts_with('`') &&
           fileOf(path).find(':') == std::string::npos;
}

std::string folderOf(const SdfLayerHandle& layer) {
    return std::filesystem::path(layer->GetRealPath()).parent_path().generic_string();
}

std::string dotted(const std::string& relative) {
    return relative.starts_with("../") ? relative : "./" + relative;
}

// Without `./` the resolver searches first beside the layer and then in its search paths.
bool isBeside(const SdfLayerHandle& layer, const std::string& path) {
    namespace fs = std::filesystem;
    const auto folder = fs::path(layer->GetRealPath()).parent_path();
    const auto file = fileOf(path);
    const bool isAtServer = isAddress(layer->GetRealPath());
    const auto isThere = [&](const std::string& name) {
        std::error_code ignored;
        if (!isAtServer) return fs::exists(folder / name, ignored);
        return bool(pxr::ArGetResolver().Resolve((folder / name).generic_string()));
    };
    if (const auto udim = file.find("<UDIM>"); udim != std::string::npos) {
        // Tiles are numbered from 1001 on. The first existing one is enough.
        for (int tile = 1001; tile < 1101; ++tile) {
            auto one = file;
            if (isThere(one.replace(udim, 6, std::to_string(tile)))) return true;
        }
        return false;
    }
    return isThere(file);
}

using Rename = std::function<std::string(const std::string&)>;

template <class Arc>
VtValue renamed(pxr::SdfListOp<Arc> arcs, const Rename& rename) {
    arcs.ModifyOperations([&](const Arc& arc) {
        Arc result = arc;
        if (!arc.GetAssetPath().empty()) result.SetAssetPath(rename(arc.GetAssetPath()));
        return std::optional<Arc>(result);
    });
    return VtValue::Take(arcs);
}

VtValue renamed(const VtValue& value, const Rename& rename) {
    if (value.IsHolding<pxr::SdfAssetPath>()) {
        const auto& path = value.UncheckedGet<pxr::SdfAssetPath>().GetAssetPath();
        return path.empty() ? value : VtValue(pxr::SdfAssetPath(rename(path)));
    }
    if (value.IsHolding<pxr::VtArray<pxr::SdfAssetPath>>()) {
        auto paths = value.UncheckedGet<pxr::VtArray<pxr::SdfAssetPath>>();
        for (auto& path : paths)
            if (!path.GetAssetPath().empty()) path = pxr::SdfAssetPath(rename(path.GetAssetPath()));
        return VtValue::Take(paths);
    }
    if (value.IsHolding<pxr::SdfReferenceListOp>())
        return renamed(value.UncheckedGet<pxr::SdfReferenceListOp>(), rename);
    if (value.IsHolding<pxr::SdfPayloadListOp>())
        return renamed(value.UncheckedGet<pxr::SdfPayloadListOp>(), rename);
    if (value.IsHolding<pxr::SdfTimeSampleMap>()) {
        auto samples = value.UncheckedGet<pxr::SdfTimeSampleMap>();
        for (auto& [time, sample] : samples) sample = renamed(sample, rename);
        return VtValue::Take(samples);
    }
    if (value.IsHolding<pxr::VtDictionary>()) {
        auto dictionary = value.UncheckedGet<pxr::VtDictionary>();
        for (auto& [key, entry] : dictionary) entry = renamed(entry, rename);
        return VtValue::Take(dictionary);
    }
    return value;
}

}  // namespace

// ------------------------------------------------------------------ sublayers

SdfLayerRefPtr createSublayer(const SdfLayerHandle& layer, int position,
                              const std::string& identifier) {
    const auto place = placeFor(layer, position);
    if (!place || !layer->PermissionToEdit()) return {};
    const usd::TfComplaints complaints;
    SdfLayerRefPtr made;
    if (identifier.empty()) {
        made = pxr::SdfLayer::CreateAnonymous(".usda");
    } else {
        const auto path = absoluteFrom(layer, identifier);
        made = pxr::SdfLayer::FindOrOpen(path);
        if (made && contains(made, layer)) return {};
        if (made) {
            if (!made->PermissionToEdit()) return {};
            made->Clear();
            if (!made->Save()) return {};
        } else {
            made = pxr::SdfLayer::CreateNew(path);
        }
    }
    if (!made || sublayerPosition(layer, made->GetIdentifier()) >= 0) return {};
    layer->InsertSubLayerPath(nameIn(layer, made), int(*place));
    return made;
}

SdfLayerRefPtr insertSublayer(const SdfLayerHandle& layer, int position,
                              const std::string& identifier, bool checkEmptyLayer) {
    const auto place = placeFor(layer, position);
    if (!place || identifier.empty() || !layer->PermissionToEdit()) return {};
    const auto found = open(absoluteFrom(layer, identifier));
    if (!found) return {};
    if (contains(found, layer) || sublayerPosition(layer, found->GetIdentifier()) >= 0) return {};
    // A layer without a format is usually a file that was not read.
    if (checkEmptyLayer && !found->IsAnonymous() && found->GetFileFormat() == nullptr) return {};
    layer->InsertSubLayerPath(nameIn(layer, found), int(*place));
    return found;
}

SdfLayerRefPtr replaceSublayer(const SdfLayerHandle& layer, int position,
                               const std::string& identifier) {
    const auto old = sublayerIdentifier(layer, position);
    if (old.empty() || identifier.empty() || !layer->PermissionToEdit()) return {};
    const auto found = open(absoluteFrom(layer, identifier));
    if (!found || contains(found, layer)) return {};
    const int there = sublayerPosition(layer, found->GetIdentifier());
    if (there >= 0 && there != position) return {};
    const pxr::SdfChangeBlock block;
    const auto offset = layer->GetSubLayerOffset(position);
    layer->RemoveSubLayerPath(position);
    layer->InsertSubLayerPath(nameIn(layer, found), position);
    layer->SetSubLayerOffset(offset, position);
    return found;
}

std::string removeSublayer(const SdfLayerHandle& layer, int position) {
    const auto identifier = sublayerIdentifier(layer, position);
    if (identifier.empty() || !layer->PermissionToEdit()) return {};
    layer->RemoveSubLayerPath(position);
    return identifier;
}

bool moveLayer(const SdfLayerHandle& fromParent, int fromPosition, const SdfLayerHandle& toParent,
               int toPosition, bool removeSource) {
    const auto identifier = sublayerIdentifier(fromParent, fromPosition);
    auto place = placeFor(toParent, toPosition);
    if (identifier.empty() || !place || !toParent->PermissionToEdit()) return false;
    const bool within = fromParent == toParent;
    const auto moving = open(identifier);
    if (moving && contains(moving, toParent)) return false;
    if (!within && sublayerPosition(toParent, identifier) >= 0) return false;
    if (removeSource && !fromParent->PermissionToEdit()) return false;
    const pxr::SdfChangeBlock block;
    const auto offset = fromParent->GetSubLayerOffset(fromPosition);
    const std::string name =
        within || !moving ? std::string(fromParent->GetSubLayerPaths()[std::size_t(fromPosition)])
                          : nameIn(toParent, moving);
    if (within || removeSource) fromParent->RemoveSubLayerPath(fromPosition);
    const int at = int(std::min(*place, toParent->GetNumSubLayerPaths()));
    toParent->InsertSubLayerPath(name, at);
    toParent->SetSubLayerOffset(offset, at);
    return true;
}

std::string sublayerIdentifier(const SdfLayerHandle& layer, int position) {
    if (!layer || position < 0 || std::size_t(position) >= layer->GetNumSubLayerPaths()) return {};
    return absoluteFrom(layer, layer->GetSubLayerPaths()[std::size_t(position)]);
}

int sublayerPosition(const SdfLayerHandle& layer, const std::string& identifier) {
    if (!layer) return -1;
    const int count = int(layer->GetNumSubLayerPaths());
    const auto wanted = absoluteFrom(layer, identifier);
    for (int position = 0; position < count; ++position)
        if (sublayerIdentifier(layer, position) == wanted) return position;
    return -1;
}

void iterateSublayers(const SdfLayerHandle& layer,
                      const std::function<bool(const SdfLayerHandle&, int, const std::string&,
                                               const SdfLayerHandle&)>& visit) {
    std::set<std::pair<std::string, std::string>> visited;
    const std::function<bool(const SdfLayerHandle&)> below = [&](const SdfLayerHandle& parent) {
        const int count = int(parent->GetNumSubLayerPaths());
        for (int position = 0; position < count; ++position) {
            const auto identifier = sublayerIdentifier(parent, position);
            if (!visited.emplace(parent->GetIdentifier(), identifier).second) continue;
            const SdfLayerHandle sublayer = open(identifier);
            if (!visit(parent, position, identifier, sublayer)) return false;
            if (sublayer && !below(sublayer)) return false;
        }
        return true;
    };
    if (layer) below(layer);
}

std::vector<std::string> allSublayers(const SdfLayerHandle& layer) {
    std::vector<std::string> all;
    iterateSublayers(layer, [&](const auto&, int, const std::string& identifier, const auto&) {
        if (std::ranges::find(all, identifier) == all.end()) all.push_back(identifier);
        return true;
    });
    return all;
}

bool isInSublayerTree(const SdfLayerHandle& layer, const std::string& identifier) {
    bool found = false;
    iterateSublayers(layer, [&](const auto&, int, const std::string& one, const auto&) {
        found = found || one == identifier;
        return !found;
    });
    return found;
}

std::vector<std::string> localDirtyLayers(const SdfLayerHandle& layer) {
    std::vector<std::string> dirty;
    const auto look = [&](const SdfLayerHandle& one) {
        const std::string id = one ? one->GetIdentifier() : std::string();
        if (one && one->IsDirty() && !one->IsAnonymous() &&
            std::ranges::find(dirty, id) == dirty.end())
            dirty.push_back(id);
        return true;
    };
    look(layer);
    iterateSublayers(layer, [&](const auto&, int, const auto&, const SdfLayerHandle& sublayer) {
        return look(sublayer);
    });
    return dirty;
}

bool hasDirtyLayers(const SdfLayerHandle& layer) { return !localDirtyLayers(layer).empty(); }

// ------------------------------------------------------------------ prims

bool hasPrimSpec(const SdfLayerHandle& layer, const pxr::SdfPath& path) {
    return layer && !path.IsEmpty() && layer->GetPrimAtPath(path);
}

bool removePrimSpec(const SdfLayerHandle& layer, const pxr::SdfPath& path) {
    if (!hasPrimSpec(layer, path) || path == pxr::SdfPath::AbsoluteRootPath() ||
        !layer->PermissionToEdit())
        return false;
    removeSpec(layer, path);
    return true;
}

bool hasRootPrimSpecs(const SdfLayerHandle& layer) {
    return layer && !layer->GetRootPrims().empty();
}

void iteratePrimSpecs(const SdfLayerHandle& layer, const pxr::SdfPath& path,
                      const std::function<bool(const pxr::SdfPrimSpecHandle&)>& visit) {
    const std::function<bool(const pxr::SdfPrimSpecHandle&)> walk = [&](const auto& prim) {
        if (prim->GetPath() != pxr::SdfPath::AbsoluteRootPath() && !visit(prim)) return false;
        for (const pxr::SdfPrimSpecHandle child : prim->GetNameChildren())
            if (!walk(child)) return false;
        const auto sets = prim->GetVariantSets();
        for (auto at = sets.begin(); at != sets.end(); ++at) {
            const pxr::SdfVariantSetSpecHandle set = at->second;
            for (const auto& variant : set->GetVariantList())
                if (!walk(variant->GetPrimSpec())) return false;
        }
        return true;
    };
    if (!layer || path.IsEmpty()) return;
    if (const auto prim = layer->GetPrimAtPath(path)) walk(prim);
}

// ------------------------------------------------------------------ content

bool transferContent(const SdfLayerHandle& from, const SdfLayerHandle& to, bool copyCustomData,
                     bool skipSublayers) {
    if (!from || !to || from == to || !to->PermissionToEdit()) return false;
    const pxr::SdfChangeBlock block;
    const auto root = pxr::SdfPath::AbsoluteRootPath();
    const auto paths = std::vector<std::string>(to->GetSubLayerPaths());
    const auto offsets = to->GetSubLayerOffsets();
    const auto data = to->GetCustomLayerData();
    to->TransferContent(from);
    if (skipSublayers) {
        to->SetSubLayerPaths(paths);
        for (std::size_t i = 0; i < offsets.size(); ++i) to->SetSubLayerOffset(offsets[i], int(i));
    }
    if (!copyCustomData) {
        if (data.empty())
            to->EraseField(root, pxr::SdfFieldKeys->CustomLayerData);
        else
            to->SetCustomLayerData(data);
    }
    resolvePaths(from, to);
    if (copyCustomData)
        reanchorStates(to, folderOf(from), to->IsAnonymous() ? std::string() : folderOf(to));
    return true;
}

void resolvePaths(const SdfLayerHandle& base, const SdfLayerHandle& target, bool storeRelativePath,
                  bool relativeToBaseLayer, bool copySublayerOffsets) {
    if (!base || !target || !target->PermissionToEdit()) return;
    const auto& anchor = relativeToBaseLayer ? base : target;
    const Rename rename = [&](const std::string& path) {
        if (base->IsAnonymous() || !isRelative(path)) return path;
        // Search paths ("X.mdl") mean the same in every layer.
        if (!hasDots(path) && !isBeside(base, path)) return path;
        const auto absolute = absoluteFrom(base, hasDots(path) ? path : "./" + path);
        return storeRelativePath ? relativeTo(anchor, absolute) : absolute;
    };
    const pxr::SdfChangeBlock block;
    const std::vector<std::string> sublayers = target->GetSubLayerPaths();
    for (std::size_t i = 0; i < sublayers.size(); ++i) {
        if (const auto name = rename(sublayers[i]); name != sublayers[i])
            target->GetSubLayerPaths()[i] = name;
        const int there = copySublayerOffsets ? sublayerPosition(base, sublayers[i]) : -1;
        if (there >= 0) target->SetSubLayerOffset(base->GetSubLayerOffset(there), int(i));
    }
    std::vector<std::pair<pxr::SdfPath, pxr::TfToken>> fields;
    target->Traverse(pxr::SdfPath::AbsoluteRootPath(), [&](const pxr::SdfPath& path) {
        for (const auto& field : target->ListFields(path)) fields.emplace_back(path, field);
    });
    for (const auto& [path, field] : fields) {
        const VtValue value = target->GetField(path, field);
        const VtValue result = renamed(value, rename);
        if (result != value) target->SetField(path, field, result);
    }
}

// ------------------------------------------------------------------ names and files

std::string customLayerName(const SdfLayerHandle& layer) {
    const VtValue name = omniValue(layer, kCustomName);
    if (name.IsHolding<pxr::TfToken>()) return name.UncheckedGet<pxr::TfToken>().GetString();
    return name.GetWithDefault<std::string>();
}

bool setCustomLayerName(const SdfLayerHandle& layer, const std::string& name) {
    return layer && setOmniValue(layer, kCustomName, name.empty() ? VtValue() : VtValue(name));
}

bool reloadLayers(const std::vector<std::string>& identifiers) {
    std::set<SdfLayerHandle> layers;
    bool all = true;
    for (const auto& identifier : identifiers) {
        const auto layer = pxr::SdfLayer::Find(identifier);
        all = all && layer;
        if (layer && !layer->IsAnonymous()) layers.insert(layer);
    }
    const usd::TfComplaints complaints;
    return pxr::SdfLayer::ReloadLayers(layers, true) && all && !complaints.hasErrors();
}

bool saveLayers(const std::vector<std::string>& identifiers, std::vector<std::string>* failed) {
    bool all = true;
    for (const auto& identifier : identifiers) {
        const usd::TfComplaints complaints;
        const auto layer = pxr::SdfLayer::Find(identifier);
        const bool saved = layer && !layer->IsAnonymous() && layer->Save();
        if (!saved && failed) failed->push_back(identifier);
        all = all && saved;
    }
    return all;
}

std::string withoutFileScheme(const std::string& url) {
    constexpr std::string_view scheme = "file://";
    if (!url.starts_with(scheme)) return url;
    const auto path = url.find('/', scheme.size());  // after an optional host
    return path == std::string::npos ? url : unquoted(url.substr(path));
}

void reanchorStates(const SdfLayerHandle& content, const std::string& fromFolder,
                    const std::string& toFolder) {
    namespace fs = std::filesystem;
    renameStoredLayers(content, [&](const std::string& path) {
        if (!isRelative(path) || fromFolder.empty()) return path;
        const auto absolute = (fs::path(fromFolder) / path).lexically_normal();
        if (toFolder.empty() || isAddress(fromFolder) != isAddress(toFolder))
            return isAddress(fromFolder) ? normalizeUrl(fromFolder + "/" + path)
                                         : absolute.generic_string();
        return dotted(absolute.lexically_relative(toFolder).generic_string());
    });
}

std::string normalizeUrl(const std::string& url) {
    if (pxr::SdfLayer::IsAnonymousLayerIdentifier(url)) return url;
    std::string text = withoutFileScheme(url);
    std::ranges::replace(text, '\\', '/');
    const auto scheme = text.find("://");
    if (scheme == std::string::npos)
        return std::filesystem::path(text).lexically_normal().generic_string();
    const auto host = text.find('/', scheme + 3);
    if (host == std::string::npos) return text;
    return text.substr(0, host) +
           std::filesystem::path(text.substr(host)).lexically_normal().generic_string();
}

}  // namespace usdlive::layers::LayerUtils
