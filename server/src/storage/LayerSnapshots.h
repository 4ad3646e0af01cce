#pragma once

#include <optional>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::server {

/// What a layer held at a revision, and that revision's chain hash, as it is of that history alone.
struct LayerSnapshot {
    Revision revision = 0;
    Hash hash;
    LayerDoc doc;
};

/// Both numbers, then the chunks of the doc (SN1), as frames.
[[nodiscard]] Bytes encodeSnapshot(const LayerSnapshot& snapshot);
/// Nothing: these bytes are none.
[[nodiscard]] std::optional<LayerSnapshot> decodeSnapshot(ByteView bytes);

}  // namespace usdlive::server
