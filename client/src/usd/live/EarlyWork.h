// Edits that an editor made in a layer before the layer was live.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <string>
#include <utility>
#include <vector>

#include "values/BlobCache.h"
#include "work/LostWorkReports.h"

namespace usdlive::client {

/// Returns the edits of a layer that is not live, since it was last live or empty.
[[nodiscard]] Result<std::vector<std::pair<std::string, EditAction>>> earlyWork(
    const pxr::SdfLayerRefPtr& layer, BlobCache& blobs);

/// Keeps these edits as lost work (M12), because the layer becomes live and its content is
/// replaced. Content that cannot be expressed as edits is kept as a file.
void keepEarlyWork(const LayerId& id, const pxr::SdfLayerRefPtr& layer, BlobCache& blobs,
                   LostWorkReports& lost);

}  // namespace usdlive::client
