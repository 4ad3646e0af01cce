// Reads and writes the links between specs and layers.
#include "usd/layers/SpecLinks.h"

#include <pxr/base/vt/array.h>
#include <pxr/base/vt/dictionary.h>

#include <algorithm>
#include <utility>

#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"
#include "usd/layers/SpecPaths.h"

namespace usdlive::layers {

using pxr::SdfPath;

namespace {

const std::string kLinks = "specs_linking";
using LinkedLayers = pxr::VtArray<std::string>;

}  // namespace

SpecLinks::SpecLinks(LayersContext& context) : context_(context) { dataChanged(); }

LayerResult<std::string> SpecLinks::localLayer(const std::string& layer) const {
    return context_.stack.named(layer).map(
        [](const LocalStack::Layer& found) { return found.layer->GetIdentifier(); });
}

template <class Edit>
LayerResult<SpecLinks::Paths> SpecLinks::changeLinks(const SdfPath& path, const std::string& layer,
                                                     bool hierarchy, Edit edit) {
    const auto specs = specsOf(context_.host, path, hierarchy);
    if (!specs) return tl::unexpected(specs.error());
    const auto target = localLayer(layer);
    if (!target) return tl::unexpected(target.error());
    Table changed = links_;
    for (const auto& one : *specs) edit(changed, one, *target);
    return change(std::move(changed));
}

LayerResult<SpecLinks::Paths> SpecLinks::linkSpec(const SdfPath& path, const std::string& layer,
                                                  bool hierarchy) {
    return changeLinks(path, layer, hierarchy, [](Table& links, const auto& spec, const auto& to) {
        links[spec].insert(to);
    });
}

LayerResult<SpecLinks::Paths> SpecLinks::unlinkSpec(const SdfPath& path, const std::string& layer,
                                                    bool hierarchy) {
    return changeLinks(path, layer, hierarchy, [](Table& links, const auto& spec, const auto& to) {
        if (const auto found = links.find(spec); found != links.end()) found->second.erase(to);
    });
}

LayerResult<SpecLinks::Paths> SpecLinks::unlinkSpecFromAllLayers(const SdfPath& path,
                                                                 bool hierarchy) {
    const auto specs = specsOf(context_.host, path, hierarchy);
    if (!specs) return tl::unexpected(specs.error());
    Table changed = links_;
    for (const auto& one : *specs) changed.erase(one);
    return change(std::move(changed));
}

LayerResult<SpecLinks::Paths> SpecLinks::unlinkSpecsToLayer(const std::string& layer) {
    const auto target = localLayer(layer);
    if (!target) return tl::unexpected(target.error());
    Table changed = links_;
    for (auto& [spec, layers] : changed) layers.erase(*target);
    return change(std::move(changed));
}

LayerResult<SpecLinks::Paths> SpecLinks::unlinkAllSpecs() { return change({}); }

LayerResult<SpecLinks::Links> SpecLinks::specLinks(const SdfPath& path, bool hierarchy) const {
    const auto specs = specsOf(context_.host, path, hierarchy);
    if (!specs) return tl::unexpected(specs.error());
    Links links;
    for (const auto& one : *specs)
        if (const auto found = links_.find(one); found != links_.end())
            links[one] = {found->second.begin(), found->second.end()};
    return links;
}

LayerResult<SpecLinks::Paths> SpecLinks::linksForLayer(const std::string& layer) const {
    const auto target = localLayer(layer);
    if (!target) return tl::unexpected(target.error());
    Paths paths;
    for (const auto& [spec, layers] : links_)
        if (layers.contains(*target)) paths.push_back(spec);
    return paths;
}

SpecLinks::Links SpecLinks::allLinks() const {
    Links links;
    for (const auto& [spec, layers] : links_) links[spec] = {layers.begin(), layers.end()};
    return links;
}

bool SpecLinks::isSpecLinked(const SdfPath& path) const { return links_.contains(path); }

bool SpecLinks::isSpecLinkedTo(const SdfPath& path, const std::string& layer) const {
    const auto found = links_.find(path);
    if (found == links_.end()) return false;
    const auto target = localLayer(layer);
    return target && found->second.contains(*target);
}

std::vector<pxr::SdfLayerHandle> SpecLinks::layersFor(const SdfPath& spec) const {
    auto found = links_.find(spec);
    if (found == links_.end() && spec.IsPropertyPath()) found = links_.find(spec.GetPrimPath());
    std::vector<pxr::SdfLayerHandle> layers;
    if (found == links_.end()) return layers;
    for (const auto& one : context_.stack.layers())
        if (found->second.contains(one.layer->GetIdentifier())) layers.push_back(one.layer);
    return layers;
}

LayerResult<SpecLinks::Paths> SpecLinks::change(Table changed) {
    std::erase_if(changed, [](const auto& entry) { return entry.second.empty(); });
    const Table before = links_;
    Paths paths;
    for (const auto& [spec, layers] : changed)
        if (const auto old = before.find(spec); old == before.end() || old->second != layers)
            paths.push_back(spec);
    for (const auto& [spec, layers] : before)
        if (!changed.contains(spec)) paths.push_back(spec);
    if (paths.empty()) return paths;
    const auto root = context_.host.rootLayer();
    pxr::VtDictionary stored;
    for (const auto& [spec, layers] : changed) {
        LinkedLayers names;
        for (const auto& layer : layers) names.push_back(relativeTo(root, layer));
        stored[spec.GetString()] = pxr::VtValue::Take(names);
    }
    links_ = std::move(changed);
    if (!setOmniDictionary(root, kLinks, std::move(stored))) {
        links_ = before;
        return fail(LayerErrorType::ReadOnly,
                    "the root layer, which stores links, accepts no edits");
    }
    notify(before);
    std::ranges::sort(paths);
    return paths;
}

void SpecLinks::notify(const Table& before) {
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

void SpecLinks::dataChanged() {
    const auto root = context_.host.rootLayer();
    Table stored;
    for (const auto& [spec, value] : omniDictionary(root, kLinks)) {
        if (!SdfPath::IsValidPathString(spec) || !value.IsHolding<LinkedLayers>()) continue;
        for (const auto& name : value.UncheckedGet<LinkedLayers>())
            stored[SdfPath(spec)].insert(storedLayer(root, name));
    }
    if (stored == links_) return;
    const Table before = std::exchange(links_, std::move(stored));
    notify(before);
}

}  // namespace usdlive::layers
