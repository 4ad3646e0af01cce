#pragma once

#include <filesystem>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server {

/// What a layer held at a revision, and that revision's chain hash, as it is of that history alone.
struct LayerSnapshot {
    Revision revision = 0;
    Hash hash;
    LayerDoc doc;
    std::size_t bytes = 0;  ///< of the file it was read from
};

/// Both numbers, then the chunks of the doc (SN1), as frames.
[[nodiscard]] Bytes encodeSnapshot(const LayerSnapshot& snapshot);
/// Nothing: these bytes are none.
[[nodiscard]] std::optional<LayerSnapshot> decodeSnapshot(ByteView bytes);

/// Of the snapshot in this file, without looking at the rest of it. Nothing: there is none.
[[nodiscard]] std::optional<Revision> snapshotRevision(const std::filesystem::path& path);

}  // namespace usdlive::server
