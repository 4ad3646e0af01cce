// Finds the layers that this process has loaded.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <memory>
#include <unordered_set>

#include "basics/Worker.h"

namespace usdlive::client {

/// Finds the layers that this process has loaded. Sdf sends no notice when it opens one, and a
/// search takes time in proportion to all loaded layers. A worker searches, for at most a twentieth
/// of its time.
///
/// Used by the thread that owns the layers. Layers that were deleted meanwhile are left out.
class LoadedLayers {
public:
    using Known = std::unordered_set<const void*>;  ///< SdfLayerHandle::GetUniqueIdentifier()

    LoadedLayers();
    ~LoadedLayers();

    /// Starts a search if it is due, or at once if `just` says that a layer may have been opened.
    /// Leaves out the layers of `known`.
    void look(bool just, const std::shared_ptr<const Known>& known, Worker& worker);
    /// Returns the next found layer, or null if there is none. Layers that the search before did
    /// not find come first.
    [[nodiscard]] pxr::SdfLayerRefPtr next();

private:
    struct State;
    std::shared_ptr<State> state_;  // shared with the worker's task
};

}  // namespace usdlive::client
