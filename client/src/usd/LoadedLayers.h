#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>
#include <unordered_set>

#include "usd/Worker.h"

namespace usdlive::client {

/// Finds out which layers this process has loaded. Sdf notifies nobody when it opens one, and a
/// look takes time in proportion to all that are loaded, so that a worker does it, for at most a
/// twentieth of its time.
///
/// Used by the thread that owns the layers. Layers that have gone meanwhile are left out.
class LoadedLayers {
public:
    using Known = std::unordered_set<const void*>;  ///< SdfLayerHandle::GetUniqueIdentifier()

    LoadedLayers();
    ~LoadedLayers();

    /// Begins to look when it is time, or at once when one may `just` have been opened. Layers of
    /// `known` are left out.
    void look(bool just, const std::shared_ptr<const Known>& known, Worker& worker);
    /// One that was found and not returned yet: first those that were not there at the look before.
    /// Null when there is none.
    [[nodiscard]] pxr::SdfLayerRefPtr next();

private:
    struct State;
    std::shared_ptr<State> state_;  // also of the worker's task
};

}  // namespace usdlive::client
