// Encodes the snapshots and bases of layers.
#pragma once

#include <filesystem>
#include <optional>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server {

/// The content of a layer at a revision, with that revision's chain hash, which identifies the
/// history.
struct LayerSnapshot {
    Revision revision = 0;
    Hash hash;
    LayerDoc doc;
    std::size_t bytes = 0;  ///< size of the file it was read from
};

/// Encodes both numbers, then the chunks of the doc (SN1), as frames.
[[nodiscard]] Bytes encodeSnapshot(const LayerSnapshot& snapshot);
/// Returns nothing if the bytes are not a snapshot.
[[nodiscard]] std::optional<LayerSnapshot> decodeSnapshot(ByteView bytes);

/// Returns the revision of the snapshot in the file without reading the rest, or nothing if there
/// is none.
[[nodiscard]] std::optional<Revision> snapshotRevision(const std::filesystem::path& path);

}  // namespace usdlive::server
