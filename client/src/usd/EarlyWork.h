// What an editor wrote into a layer before the layer was live.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <string>
#include <utility>
#include <vector>

#include "usd/BlobCache.h"
#include "usd/LostWorkReports.h"

namespace usdlive::client {

/// The edits that a layer holds which is not live, since it was last live or empty.
[[nodiscard]] Result<std::vector<std::pair<std::string, EditAction>>> earlyWork(
    const pxr::SdfLayerRefPtr& layer, BlobCache& blobs);

/// Keeps these edits as lost work (M12): the layer becomes live now, and its content is replaced.
/// Work that cannot be expressed as edits is kept as a file.
void keepEarlyWork(const LayerId& id, const pxr::SdfLayerRefPtr& layer, BlobCache& blobs,
                   LostWorkReports& lost);

}  // namespace usdlive::client
