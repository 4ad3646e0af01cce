// Decides which layers of the project are read as files.
#include "usd/assets/ClipFiles.h"

#include <pxr/usd/sdf/layerUtils.h>

#include <algorithm>
#include <string_view>

#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::client {

namespace {

std::string_view fileNameIn(std::string_view path) { return path.substr(path.rfind('/') + 1); }

}  // namespace

ClipFiles::ClipFiles(const LayerPlaces& places, PlainFiles& files,
                     std::function<bool(const LayerId&)> mayBeFile)
    : places_(places), projectFiles_(files), mayBeFile_(std::move(mayBeFile)) {}

std::optional<LayerId> ClipFiles::named(const pxr::SdfLayerHandle& layer,
                                        const std::string& asset) const {
    return places_.layerAt(pxr::SdfComputeAssetPathRelativeToLayer(layer, asset));
}

bool ClipFiles::areClips(const LayerId& id) const {
    return named_.contains(id) || std::ranges::any_of(templates_, [&](const LayerId& pattern) {
               return usd::matchesTemplate(pattern.value, id.value);
           });
}

bool ClipFiles::hasArc(const LayerId& id) const {
    const auto found = arcs_.find(fileNameIn(id.value));
    return found != arcs_.end() && std::ranges::any_of(found->second, [&](const auto& arc) {
               return arc.first && named(arc.first, arc.second) == id;
           });
}

void ClipFiles::addClips(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets,
                         const std::set<LayerId>& project) {
    if (!projectFiles_.isStarted()) return;
    for (const std::string& asset : assets) {
        const auto id = named(layer, asset);
        if (!id) continue;
        if (!usd::isTemplate(asset)) {
            if (named_.insert(*id).second) add(*id);
        } else if (templates_.insert(*id).second) {
            addMatching(*id, project);
        }
    }
}

void ClipFiles::addArcs(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets) {
    if (!projectFiles_.isStarted()) return;
    for (const std::string& asset : assets) {
        auto& arcs = arcs_[std::string(fileNameIn(asset))];
        if (!arcs.emplace(layer, asset).second || files_.empty()) continue;
        if (const auto id = named(layer, asset)) opens(*id);
    }
}

void ClipFiles::opens(const LayerId& id) {
    if (files_.erase(id) == 0) return;
    projectFiles_.readAsFile(id.value, false);
}

void ClipFiles::closed(const LayerId& id) {
    // A layer that is still loaded has its content.
    if (areClips(id) && mayBeFile_(id) && !hasArc(id)) mark(id);
}

void ClipFiles::projectChanged(const std::vector<LayerId>& added) {
    // A file that is gone stays one, because it may come back.
    for (const LayerId& id : named_) add(id);
    const std::set<LayerId> sorted =
        templates_.empty() ? std::set<LayerId>() : std::set(added.begin(), added.end());
    for (const LayerId& pattern : templates_) addMatching(pattern, sorted);
}

void ClipFiles::add(const LayerId& id) {
    if (files_.contains(id) || !mayBeFile_(id) || hasArc(id)) return;
    // A layer that composition has opened before is empty until it is filled.
    if (!pxr::SdfLayer::Find(places_.identifierOf(id))) mark(id);
}

void ClipFiles::mark(const LayerId& id) {
    if (files_.insert(id).second) projectFiles_.readAsFile(id.value, true);
}

void ClipFiles::addMatching(const LayerId& pattern, const std::set<LayerId>& project) {
    const std::string prefix = pattern.value.substr(0, pattern.value.find('#'));
    for (auto id = project.lower_bound(LayerId{prefix});
         id != project.end() && id->value.starts_with(prefix); ++id)
        if (usd::matchesTemplate(pattern.value, id->value)) add(*id);
}

}  // namespace usdlive::client
