#pragma once

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// The layer as it stood at a revision, made again from the commits. What was never brought in
/// until then stands as it was when it was, for its file was nobody's work. LayerNotFound: never at
/// all. Reads the whole log up to the revision.
[[nodiscard]] Result<LayerDoc> layerAt(const CommitStore& store, const LayerId& layer,
                                       Revision revision);

}  // namespace usdlive::server
