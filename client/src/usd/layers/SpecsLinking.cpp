#include "usdlive/client/usd/layers/SpecsLinking.h"

#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>

#include <algorithm>

#include "usdlive/client/usd/layers/OmniLayerData.h"
#include "usdlive/client/usd/layers/SpecPaths.h"

namespace usdlive::layers {

using pxr::SdfPath;

namespace {

const std::string kLinks = "specs_linking";
using Names = pxr::VtArray<std::string>;

LastError noSpec(const std::string& path) {
    return {LayerErrorType::InvalidParam, "the stage has no prim or property at '" + path + "'"};
}

}  // namespace

SpecsLinking::SpecsLinking(LayersContext& context) : context_(context) { dataChanged(); }

std::string SpecsLinking::localLayer(const std::string& layer) {
    const auto wanted = absoluteFrom(context_.host.rootLayer(), layer);
    for (const auto& one : context_.stack.layers())
        if (one.layer->GetIdentifier() == wanted || one.layer->GetIdentifier() == layer)
            return one.layer->GetIdentifier();
    context_.fail(LayerErrorType::NotFound, "the stage has no local layer '" + layer + "'");
    return {};
}

template <class Edit>
SpecsLinking::Paths SpecsLinking::changeLinks(const std::string& path, const std::string& layer,
                                              bool hierarchy, Edit edit) {
    const auto spec = specPath(context_.host, path);
    if (!spec) return context_.error = noSpec(path), Paths();
    const auto target = localLayer(layer);
    if (target.empty()) return {};
    Table changed = links_;
    for (const auto& one : specsOf(context_.host, *spec, hierarchy)) edit(changed, one, target);
    return change(std::move(changed));
}

SpecsLinking::Paths SpecsLinking::linkSpec(const std::string& path, const std::string& layer,
                                           bool hierarchy) {
    return changeLinks(path, layer, hierarchy, [](Table& links, const auto& spec, const auto& to) {
        links[spec].insert(to);
    });
}

SpecsLinking::Paths SpecsLinking::unlinkSpec(const std::string& path, const std::string& layer,
                                             bool hierarchy) {
    return changeLinks(path, layer, hierarchy, [](Table& links, const auto& spec, const auto& to) {
        if (const auto found = links.find(spec); found != links.end()) found->second.erase(to);
    });
}

SpecsLinking::Paths SpecsLinking::unlinkSpecFromAllLayers(const std::string& path, bool hierarchy) {
    const auto spec = specPath(context_.host, path);
    if (!spec) return context_.error = noSpec(path), Paths();
    Table changed = links_;
    for (const auto& one : specsOf(context_.host, *spec, hierarchy)) changed.erase(one);
    return change(std::move(changed));
}

SpecsLinking::Paths SpecsLinking::unlinkSpecsToLayer(const std::string& layer) {
    const auto target = localLayer(layer);
    if (target.empty()) return {};
    Table changed = links_;
    for (auto& [spec, layers] : changed) layers.erase(target);
    return change(std::move(changed));
}

void SpecsLinking::unlinkAllSpecs() { change({}); }

SpecsLinking::Links SpecsLinking::specLinks(const std::string& path, bool hierarchy) {
    const auto spec = specPath(context_.host, path);
    if (!spec) return context_.error = noSpec(path), Links();
    context_.succeed();
    Links links;
    for (const auto& one : specsOf(context_.host, *spec, hierarchy))
        if (const auto found = links_.find(one); found != links_.end())
            links[one] = {found->second.begin(), found->second.end()};
    return links;
}

SpecsLinking::Paths SpecsLinking::linksForLayer(const std::string& layer) {
    const auto target = localLayer(layer);
    Paths paths;
    if (target.empty()) return paths;
    context_.succeed();
    for (const auto& [spec, layers] : links_)
        if (layers.contains(target)) paths.push_back(spec);
    return paths;
}

SpecsLinking::Links SpecsLinking::allLinks() const {
    Links links;
    for (const auto& [spec, layers] : links_) links[spec] = {layers.begin(), layers.end()};
    return links;
}

bool SpecsLinking::isSpecLinked(const std::string& path, const std::string& layer) {
    const auto found = SdfPath::IsValidPathString(path) ? links_.find(SdfPath(path)) : links_.end();
    if (found == links_.end()) return false;
    if (layer.empty()) return true;
    const auto target = localLayer(layer);
    return !target.empty() && found->second.contains(target);
}

std::vector<pxr::SdfLayerHandle> SpecsLinking::layersFor(const SdfPath& spec) const {
    auto found = links_.find(spec);
    if (found == links_.end() && spec.IsPropertyPath()) found = links_.find(spec.GetPrimPath());
    std::vector<pxr::SdfLayerHandle> layers;
    if (found == links_.end()) return layers;
    for (const auto& one : context_.stack.layers())
        if (found->second.contains(one.layer->GetIdentifier())) layers.push_back(one.layer);
    return layers;
}

SpecsLinking::Paths SpecsLinking::change(Table changed) {
    std::erase_if(changed, [](const auto& entry) { return entry.second.empty(); });
    context_.succeed();
    const Table before = links_;
    Paths paths;
    for (const auto& [spec, layers] : changed)
        if (const auto old = before.find(spec); old == before.end() || old->second != layers)
            paths.push_back(spec);
    for (const auto& [spec, layers] : before)
        if (!changed.contains(spec)) paths.push_back(spec);
    if (paths.empty()) return {};
    const auto root = context_.host.rootLayer();
    pxr::VtDictionary stored;
    for (const auto& [spec, layers] : changed) {
        Names names;
        for (const auto& layer : layers) names.push_back(relativeTo(root, layer));
        stored[spec.GetString()] = pxr::VtValue::Take(names);
    }
    links_ = std::move(changed);
    if (!setOmniDictionary(root, kLinks, std::move(stored))) {
        links_ = before;
        context_.fail(LayerErrorType::ReadOnly,
                      "the root layer, in which links are kept, takes no edits");
        return {};
    }
    tell(before);
    std::ranges::sort(paths);
    return paths;
}

void SpecsLinking::tell(const Table& before) {
    std::map<std::string, std::set<std::string>> changed;
    const auto compare = [&](const Table& one, const Table& other) {
        for (const auto& [spec, layers] : one)
            for (const auto& layer : layers) {
                const auto found = other.find(spec);
                if (found == other.end() || !found->second.contains(layer))
                    changed[layer].insert(spec.GetString());
            }
    };
    compare(before, links_);
    compare(links_, before);
    if (changed.empty()) return;
    LayerEvent event;
    event.type = LayerEventType::SpecsLinkingChanged;
    for (const auto& [layer, specs] : changed)
        event.entries.emplace_back(layer, std::vector<std::string>(specs.begin(), specs.end()));
    context_.events.push(std::move(event));
}

void SpecsLinking::dataChanged() {
    const auto root = context_.host.rootLayer();
    Table stored;
    for (const auto& [spec, value] : omniDictionary(root, kLinks)) {
        if (!SdfPath::IsValidPathString(spec) || !value.IsHolding<Names>()) continue;
        for (const auto& name : value.UncheckedGet<Names>())
            stored[SdfPath(spec)].insert(storedLayer(root, name));
    }
    if (stored == links_) return;
    const Table before = std::exchange(links_, std::move(stored));
    tell(before);
}

}  // namespace usdlive::layers
