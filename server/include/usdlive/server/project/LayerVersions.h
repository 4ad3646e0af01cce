// Names for the content of layers.
#pragma once

#include <optional>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// Names the content of a layer: two equal versions of a layer have the same content.
struct LayerVersion {
    Revision revision = 0;
    Hash hash;  ///< chain hash at the revision
    bool operator==(const LayerVersion&) const = default;
};

/// Finds the versions of layers. Stores implement it beside CommitStore.
class LayerVersions {
public:
    virtual ~LayerVersions() = default;

    /// Returns a revision at which CommitStore::layerAt() returns the same content as at
    /// `revision`: usually the last commit that changed the layer. Nothing: no commit is for the
    /// layer. Errors: as layerAt().
    [[nodiscard]] virtual Result<std::optional<LayerVersion>> versionAt(
        const LayerId& layer, Revision revision) const = 0;
};

/// Asks a store that implements LayerVersions, as all stores of usdlive do.
[[nodiscard]] inline Result<std::optional<LayerVersion>> versionAt(const CommitStore& store,
                                                                   const LayerId& layer,
                                                                   Revision revision) {
    return dynamic_cast<const LayerVersions&>(store).versionAt(layer, revision);
}

}  // namespace usdlive::server
