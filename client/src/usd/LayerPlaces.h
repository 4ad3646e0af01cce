// The interface between a project's layers and the names under which a process finds them.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <optional>
#include <string>
#include <vector>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Where the layers of a project are for this process: the SdfLayer of a layer, the layer of an
/// SdfLayer, and what lets composition open a layer before its content has arrived. Nothing else in
/// the client knows file paths of layers. Used by one thread.
class LayerPlaces {
public:
    virtual ~LayerPlaces() = default;

    /// The identifier with which SdfLayer::FindOrOpen() opens the layer.
    [[nodiscard]] virtual std::string identifierOf(const LayerId& layer) const = 0;
    /// The layer with this identifier. Nothing: the identifier is of another place. Decides by the
    /// name alone: the project need not have the layer.
    [[nodiscard]] virtual std::optional<LayerId> layerAt(const std::string& identifier) const = 0;
    /// The same of an SdfLayer, which is neither null nor anonymous.
    [[nodiscard]] virtual std::optional<LayerId> layerOf(
        const pxr::SdfLayerHandle& layer) const = 0;

    /// Lets FindOrOpen() find the layer, without content where this place has none. Returns whether
    /// that had to be done.
    virtual Result<bool> makeFindable(const LayerId& layer) = 0;
    /// Undoes makeFindable() for a layer that turned out not to be in the project.
    virtual void remove(const LayerId& layer) = 0;
    /// Does makeFindable() for layers that the project has from now on: for those that `budgetMs`
    /// is enough for before it returns, for the others soon.
    virtual void add(std::vector<LayerId> layers, double budgetMs) = 0;
    /// All layers of add() can be found.
    [[nodiscard]] virtual bool isComplete() const = 0;
    /// The first failure of add() since the last call.
    [[nodiscard]] virtual std::optional<Error> takeError() = 0;
};

}  // namespace usdlive::client
