#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "usdlive/client/usd/layers/LayersContext.h"

namespace usdlive::layers {

/// Which layers the edits of a spec go to in the edit mode SpecsLinking. Kept in the root layer's
/// customLayerData, `omni_layer:specs_linking` {spec path: [layers]}, so that links are shared live
/// and survive.
///
/// Functions that change links return the specs whose links really changed; none and an error for a
/// path or layer that the stage does not have.
class SpecsLinking {
public:
    using Paths = std::vector<pxr::SdfPath>;
    using Links = std::map<pxr::SdfPath, std::vector<std::string>>;

    explicit SpecsLinking(LayersContext& context);

    Paths linkSpec(const std::string& path, const std::string& layer, bool hierarchy);
    Paths unlinkSpec(const std::string& path, const std::string& layer, bool hierarchy);
    Paths unlinkSpecFromAllLayers(const std::string& path, bool hierarchy);
    Paths unlinkSpecsToLayer(const std::string& layer);
    void unlinkAllSpecs();

    [[nodiscard]] Links specLinks(const std::string& path, bool hierarchy);
    [[nodiscard]] Paths linksForLayer(const std::string& layer);
    [[nodiscard]] Links allLinks() const;
    /// To any layer when none is named.
    [[nodiscard]] bool isSpecLinked(const std::string& path, const std::string& layer);

    /// Where edits of the spec go: its own links, else those of its prim. None: it is not linked.
    [[nodiscard]] std::vector<pxr::SdfLayerHandle> layersFor(const pxr::SdfPath& spec) const;

    /// The root layer's customLayerData has changed.
    void dataChanged();

private:
    using Table = std::map<pxr::SdfPath, std::set<std::string>>;

    [[nodiscard]] std::string localLayer(const std::string& layer);
    template <class Edit>
    Paths changeLinks(const std::string& path, const std::string& layer, bool hierarchy, Edit edit);
    Paths change(Table changed);
    void tell(const Table& before);

    LayersContext& context_;
    Table links_;
};

}  // namespace usdlive::layers
