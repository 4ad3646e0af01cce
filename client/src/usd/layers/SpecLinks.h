// The table of links from specs to layers.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/SpecsLinking.h"

namespace usdlive::layers {

struct LayersContext;

/// Keeps the links from specs to layers, and reads and writes them in the root layer's
/// customLayerData. SpecsLinking shows it to users and says what the functions do.
class SpecLinks {
public:
    using Paths = SpecsLinking::Paths;
    using Links = SpecsLinking::Links;

    explicit SpecLinks(LayersContext& context);

    LayerResult<Paths> linkSpec(const pxr::SdfPath& path, const std::string& layer, bool hierarchy);
    LayerResult<Paths> unlinkSpec(const pxr::SdfPath& path, const std::string& layer,
                                  bool hierarchy);
    LayerResult<Paths> unlinkSpecFromAllLayers(const pxr::SdfPath& path, bool hierarchy);
    LayerResult<Paths> unlinkSpecsToLayer(const std::string& layer);
    LayerResult<Paths> unlinkAllSpecs();

    [[nodiscard]] LayerResult<Links> specLinks(const pxr::SdfPath& path, bool hierarchy) const;
    [[nodiscard]] LayerResult<Paths> linksForLayer(const std::string& layer) const;
    [[nodiscard]] Links allLinks() const;
    [[nodiscard]] bool isSpecLinked(const pxr::SdfPath& path) const;
    [[nodiscard]] bool isSpecLinkedTo(const pxr::SdfPath& path, const std::string& layer) const;
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layersFor(const pxr::SdfPath& spec) const;

    /// Call when the root layer's customLayerData has changed.
    void dataChanged();

private:
    using Table = std::map<pxr::SdfPath, std::set<std::string>>;

    [[nodiscard]] LayerResult<std::string> localLayer(const std::string& layer) const;
    template <class Edit>
    LayerResult<Paths> changeLinks(const pxr::SdfPath& path, const std::string& layer,
                                   bool hierarchy, Edit edit);
    LayerResult<Paths> change(Table changed);
    void notify(const Table& before);

    LayersContext& context_;
    Table links_;
};

}  // namespace usdlive::layers
