// Decides which layers of the project are read as files.
#include "usd/ClipFiles.h"

#include <pxr/usd/sdf/layerUtils.h>

#include <algorithm>
#include <utility>

#include "usdlive/common/usd/NamedAssets.h"

namespace usdlive::client {

ClipFiles::ClipFiles(const LayerPlaces& places, ProjectFiles& files,
                     std::function<bool(const LayerId&)> mayBeFile)
    : places_(places), projectFiles_(files), mayBeFile_(std::move(mayBeFile)) {}

std::optional<LayerId> ClipFiles::named(const pxr::SdfLayerHandle& layer,
                                        const std::string& asset) const {
    const auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(layer, asset);
    return places_.layerAt(pxr::SdfLayer::SplitIdentifier(identifier).first);
}

void ClipFiles::addClips(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets,
                         const std::vector<LayerId>& project) {
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
    if (files_.empty() || assets.empty()) return;
    std::set<std::string_view> names;
    const auto nameOf = [](std::string_view path) { return path.substr(path.rfind('/') + 1); };
    for (const LayerId& id : files_) names.insert(nameOf(id.value));
    for (const std::string& asset : assets)
        if (names.contains(nameOf(asset)))
            if (const auto id = named(layer, asset)) compose(*id);
}

void ClipFiles::compose(const LayerId& id) {
    composed_.insert(id);
    if (files_.erase(id) > 0) projectFiles_.readAsFile(id.value, false);
}

void ClipFiles::setOfProject(const std::vector<LayerId>& project) {
    for (const LayerId& id : std::set(files_))
        if (!std::ranges::binary_search(project, id)) {
            files_.erase(id);
            projectFiles_.readAsFile(id.value, false);
        }
    for (const LayerId& id : named_) add(id);
    for (const LayerId& pattern : templates_) addMatching(pattern, project);
}

void ClipFiles::add(const LayerId& id) {
    if (composed_.contains(id) || !mayBeFile_(id) || !files_.insert(id).second) return;
    projectFiles_.readAsFile(id.value, true);
}

void ClipFiles::addMatching(const LayerId& pattern, const std::vector<LayerId>& project) {
    const std::string prefix = pattern.value.substr(0, pattern.value.find('#'));
    for (auto id = std::ranges::lower_bound(project, LayerId{prefix});
         id != project.end() && id->value.starts_with(prefix); ++id)
        if (usd::matchesTemplate(pattern.value, id->value)) add(*id);
}

}  // namespace usdlive::client
