// How parts of a project follow its layers.
#pragma once

#include <optional>

#include "usdlive/server/project/Project.h"

namespace usdlive::server {

/// A part that keeps something for each layer, or waits for layers to be loaded.
class LayerListener {
public:
    virtual ~LayerListener() = default;

    /// The layer's document was put in. An import is not ordered yet.
    virtual void loaded(const LayerId& /*layer*/, const LoadedLayer& /*loaded*/) {}
    /// The layer can be used. `imported`: it came from its file just now.
    virtual void ready(const LayerId& /*layer*/, bool /*imported*/) {}
    /// It could not be loaded: all that waits for it fails. The next use makes another attempt.
    virtual void failed(const LayerId& /*layer*/, const Error& /*error*/) {}
    /// It is no layer of the project any more.
    virtual void removed(const LayerId& /*layer*/) {}
};

}  // namespace usdlive::server
