// Lost edits as a sparse layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include "session/Session.h"
#include "usdlive/common/layer/Blobs.h"

namespace usdlive::client {

/// Returns the lost edits of one layer as a new sparse layer (M12), with overs for the ancestors of
/// edited specs, so that it can be used as a stronger layer above the project's. `known` is the
/// layer in the project, or nullptr; it supplies the kinds and types of specs that the edits
/// assume. Edits that cannot be expressed in such a layer, such as deletions of the project's
/// specs, are skipped.
[[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkLayer(const LostWork& work, const LayerId& layer,
                                                        const LayerDoc* known, BlobSource& blobs);

}  // namespace usdlive::client
