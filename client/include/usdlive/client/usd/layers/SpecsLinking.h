// Links from specs to the layers that receive their edits.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <map>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayerTypes.h"

namespace usdlive::layers {

class SpecLinks;

/// The layers that receive the edits of a spec in the edit mode SpecsLinking. Kept in the root
/// layer's customLayerData, `omni_layer:specs_linking` {spec path: [layers]}, so that links are
/// shared live and saved. Part of a Layers, which returns it.
///
/// Functions that change links return the specs whose links have changed. They fail for a path or
/// layer that the stage does not have, and if the root layer accepts no edits.
class SpecsLinking {
public:
    using Paths = std::vector<pxr::SdfPath>;
    using Links = std::map<pxr::SdfPath, std::vector<std::string>>;

    SpecsLinking(const SpecsLinking&) = delete;
    SpecsLinking& operator=(const SpecsLinking&) = delete;

    LayerResult<Paths> linkSpec(const pxr::SdfPath& path, const std::string& layer, bool hierarchy);
    LayerResult<Paths> unlinkSpec(const pxr::SdfPath& path, const std::string& layer,
                                  bool hierarchy);
    LayerResult<Paths> unlinkSpecFromAllLayers(const pxr::SdfPath& path, bool hierarchy);
    LayerResult<Paths> unlinkSpecsToLayer(const std::string& layer);
    LayerResult<Paths> unlinkAllSpecs();

    [[nodiscard]] LayerResult<Links> specLinks(const pxr::SdfPath& path, bool hierarchy) const;
    [[nodiscard]] LayerResult<Paths> linksForLayer(const std::string& layer) const;
    [[nodiscard]] Links allLinks() const;
    /// Returns true if the spec is linked to any layer.
    [[nodiscard]] bool isSpecLinked(const pxr::SdfPath& path) const;
    [[nodiscard]] bool isSpecLinkedTo(const pxr::SdfPath& path, const std::string& layer) const;

    /// Returns the layers for edits of the spec: from its own links, otherwise from those of its
    /// prim. Empty if it is not linked.
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layersFor(const pxr::SdfPath& spec) const;

private:
    friend class Layers;
    explicit SpecsLinking(SpecLinks& links) : links_(links) {}

    SpecLinks& links_;
};

}  // namespace usdlive::layers
