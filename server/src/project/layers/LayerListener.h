// The interface by which parts of a project follow its layers.
#pragma once

#include <optional>

#include "project/Project.h"

namespace usdlive::server {

/// A part that keeps data for each layer, or waits for layers to be loaded.
class LayerListener {
public:
    virtual ~LayerListener() = default;

    /// Called when the layer's document was added to the line. The commit of an import is not
    /// ordered yet.
    virtual void loaded(const LayerId& /*layer*/, const LoadedLayer& /*loaded*/) {}
    /// Called when the layer can be used. `imported` means that it was just imported from its file.
    virtual void ready(const LayerId& /*layer*/, bool /*imported*/) {}
    /// Called when the layer could not be loaded: operations that wait for it fail. The next use
    /// tries again.
    virtual void failed(const LayerId& /*layer*/, const Error& /*error*/) {}
    /// Called when the layer was removed from the project.
    virtual void removed(const LayerId& /*layer*/) {}
};

}  // namespace usdlive::server
