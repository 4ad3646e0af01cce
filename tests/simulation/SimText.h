// Converts layers to text and back, with USD.
#pragma once

#include <string>

#include "project/CommitStore.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::simulation {

/// Returns the text of a layer's file, written by USD and read back. Throws SimFailure when that
/// fails.
std::string usdText(const LayerDoc& doc, const server::BlobStore& blobs);

}  // namespace usdlive::simulation
