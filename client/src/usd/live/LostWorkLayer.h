// Lost edits as a sparse layer.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include "session/Session.h"
#include "usdlive/common/layer/Blobs.h"

namespace usdlive::client {

/// Returns the content of sparseLayer() as a new layer.
[[nodiscard]] Result<pxr::SdfLayerRefPtr> lostWorkLayer(const LostWork& work, const LayerId& layer,
                                                        const LayerDoc* known, BlobSource& blobs);

}  // namespace usdlive::client
