// Shows the links of specs to users.
#include "usdlive/client/usd/layers/SpecsLinking.h"

#include "usd/layers/SpecLinks.h"

namespace usdlive::layers {

using pxr::SdfPath;

LayerResult<SpecsLinking::Paths> SpecsLinking::linkSpec(const SdfPath& path,
                                                        const std::string& layer, bool hierarchy) {
    return links_.linkSpec(path, layer, hierarchy);
}

LayerResult<SpecsLinking::Paths> SpecsLinking::unlinkSpec(const SdfPath& path,
                                                          const std::string& layer,
                                                          bool hierarchy) {
    return links_.unlinkSpec(path, layer, hierarchy);
}

LayerResult<SpecsLinking::Paths> SpecsLinking::unlinkSpecFromAllLayers(const SdfPath& path,
                                                                       bool hierarchy) {
    return links_.unlinkSpecFromAllLayers(path, hierarchy);
}

LayerResult<SpecsLinking::Paths> SpecsLinking::unlinkSpecsToLayer(const std::string& layer) {
    return links_.unlinkSpecsToLayer(layer);
}

LayerResult<SpecsLinking::Paths> SpecsLinking::unlinkAllSpecs() { return links_.unlinkAllSpecs(); }

LayerResult<SpecsLinking::Links> SpecsLinking::specLinks(const SdfPath& path,
                                                         bool hierarchy) const {
    return links_.specLinks(path, hierarchy);
}

LayerResult<SpecsLinking::Paths> SpecsLinking::linksForLayer(const std::string& layer) const {
    return links_.linksForLayer(layer);
}

SpecsLinking::Links SpecsLinking::allLinks() const { return links_.allLinks(); }

bool SpecsLinking::isSpecLinked(const SdfPath& path) const { return links_.isSpecLinked(path); }

bool SpecsLinking::isSpecLinkedTo(const SdfPath& path, const std::string& layer) const {
    return links_.isSpecLinkedTo(path, layer);
}

std::vector<pxr::SdfLayerHandle> SpecsLinking::layersFor(const SdfPath& spec) const {
    return links_.layersFor(spec);
}

}  // namespace usdlive::layers
