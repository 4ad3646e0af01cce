// Lost edits as the content of a sparse layer.
#pragma once

#include <functional>
#include <string>

#include "session/Session.h"

namespace usdlive::client {

/// Returns the content of a sparse layer with the lost edits of one layer (M12), with overs for the
/// ancestors of edited specs, so that it can be used as a stronger layer above the project's.
/// `known` is the layer in the project, or nullptr; it supplies the kinds and types of specs that
/// the edits assume. `nameOfType` names the type of an attribute with this value, which may be a
/// blob; an empty text means that there is none. Edits that cannot be expressed in such a layer,
/// such as deletions of the project's specs, are skipped.
[[nodiscard]] LayerDoc sparseLayer(const LostWork& work, const LayerId& layer,
                                   const LayerDoc* known,
                                   const std::function<std::string(const Value&)>& nameOfType);

}  // namespace usdlive::client
