// The files of a stage's layers.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "usd/layers/FileWatch.h"
#include "usd/layers/LayerIdSet.h"
#include "usd/layers/StageLayers.h"
#include "usdlive/client/usd/layers/LiveLayers.h"

namespace usdlive::layers {

struct LayersContext;

/// Knows the states of the layers' files as of the last check: outdated, read-only, and the owner.
/// For a live layer these are the states of the server's file.
class LayerFileStates {
public:
    LayerFileStates(LayersContext& context, StageLayers& layers);

    [[nodiscard]] bool isOutdated(const StageLayers::Layer& layer) const;
    [[nodiscard]] bool isReadOnly(const StageLayers::Layer& layer) const;
    [[nodiscard]] std::string ownerOf(const StageLayers::Layer& layer) const;

    /// Looks at the file of a layer that was found, without reading it, for queries before the
    /// first check. `live` is empty if the layer is not live.
    void add(const StageLayers::Layer& layer, const std::optional<LiveState>& live);
    void remove(const std::string& id);

    struct Changes {
        bool permission = false;  ///< became read-only or writable
        bool outdated = false;    ///< became outdated or up to date
        bool reload = false;      ///< is to be reloaded, if that happens automatically
    };
    /// Checks the file. It must not be anonymous.
    [[nodiscard]] Changes check(const StageLayers::Layer& layer,
                                const std::optional<LiveState>& live);

    /// Reads the files, and asks the server to reload live layers; the server reports when these
    /// are up to date. Returns false if not all files can be read.
    bool reload(const std::vector<std::string>& ids);
    /// Call when this process has written or read the layer's file, so that check() does not report
    /// it.
    void agrees(const pxr::SdfLayerHandle& layer);

private:
    LayersContext& context_;
    StageLayers& layers_;
    FileWatch watch_;
    LayerIdSet outdated_, readOnly_;
    std::unordered_map<std::string, std::string> owners_;
};

}  // namespace usdlive::layers
