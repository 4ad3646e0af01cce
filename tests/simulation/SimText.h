#pragma once

#include <string>

#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::simulation {

/// What a layer's file would say, written by USD and read back. Throws SimFailure when it cannot
/// be.
std::string usdText(const LayerDoc& doc, const server::BlobStore& blobs);

}  // namespace usdlive::simulation
