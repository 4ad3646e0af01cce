// Writes layers with big arrays as text, in parts, and reads such files.
#pragma once

#include <filesystem>

#include "project/CommitStore.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server {

/// Writes a layer with big arrays of numbers as `.usda` text into `file`, one part of an array at a
/// time. OpenUSD parses each part of the text as it is written, and once the text around the
/// arrays. This verifies the text with little memory: OpenUSD needs about 100 bytes for each number
/// of an array that it parses.
///
/// Returns false without writing if the layer has no such arrays or its text cannot be checked in
/// this way.
[[nodiscard]] Result<bool> writeTextInParts(const std::filesystem::path& file, const LayerDoc& doc,
                                            BlobStore& blobs);

}  // namespace usdlive::server
