// The interface between a project's layers and the names under which a process finds them.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <string>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Maps the layers of a project to the identifiers of SdfLayers in this process, and lets
/// composition open a layer before its content has arrived. No other part of the client knows file
/// paths of layers. Used by one thread.
class LayerPlaces {
public:
    virtual ~LayerPlaces() = default;

    /// Returns the identifier with which SdfLayer::FindOrOpen() opens the layer.
    [[nodiscard]] virtual std::string identifierOf(const LayerId& layer) const = 0;
    /// Returns the layer with this identifier; nothing if the identifier belongs to another place.
    /// Depends on the name only: the project may not have the layer. File format arguments of the
    /// identifier are ignored.
    [[nodiscard]] virtual std::optional<LayerId> layerAt(const std::string& identifier) const = 0;
    /// Does the same for an SdfLayer, which is neither null nor anonymous.
    [[nodiscard]] virtual std::optional<LayerId> layerOf(
        const pxr::SdfLayerHandle& layer) const = 0;

    /// Returns whether the layer's file is a placeholder, which nobody reads: edits of the layer go
    /// nowhere unless it is live.
    [[nodiscard]] virtual bool isPlaceholder(const pxr::SdfLayerHandle& layer) const = 0;

    /// Makes sure that FindOrOpen() finds the layer, without content if this place has none.
    /// Returns whether something had to be created.
    virtual Result<bool> makeFindable(const LayerId& layer) = 0;
    /// Undoes makeFindable() for a layer that is not in the project.
    virtual void remove(const LayerId& layer) = 0;
    /// Calls makeFindable() for new layers of the project: for as many as fit into `budgetMs`
    /// before it returns, and for the others soon afterwards.
    virtual void add(std::vector<LayerId> layers, double budgetMs) = 0;
    /// Returns whether all layers of add() can be found.
    [[nodiscard]] virtual bool isComplete() const = 0;
    /// Returns the first error of add() since the last call.
    [[nodiscard]] virtual std::optional<Error> takeError() = 0;
};

}  // namespace usdlive::client
