// Finds what an editor has changed in a layer, by a comparison with what it was shown.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "usdlive/client/session/Events.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/Blobs.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::client {

/// A spec of the editor's layer: all its fields, as encodeFieldValue() encodes them, with big
/// values inline, and the names of its children in their order, by ChildList.
struct SeenSpec {
    std::string path;
    SpecKind kind = SpecKind::Prim;
    std::vector<std::pair<std::string, ByteView>> fields;
    std::array<std::vector<std::string>, 4> children;
};

/// The result of a comparison.
struct LayerChanges {
    /// Content that cannot be shared, and the reason.
    struct Refused {
        std::string path, field;
        Error reason;
    };
    std::vector<AuthoredEdit> edits;
    std::vector<Refused> refused;
    LayerDoc after;  ///< the shown content, with the edits
};

/// Compares the editor's layer with `shown`, the content that it was given.
///
/// `seen` has the specs of the editor's layer that may have changed: all of them, or some. A spec
/// that is new has everything below it directly after it, and its parent before it. `keeps` is
/// called for content of `shown` that the editor's layer does not have, with the encoded content of
/// the field or its part; for a spec, `field` is empty. It returns whether the content stays
/// because the editor's OpenUSD cannot express it. Big values go to `blobs`; those of `shown` that
/// are not here stay.
///
/// A spec that is gone while one new spec has the same content was moved.
[[nodiscard]] LayerChanges compareLayer(
    const LayerId& layer, const LayerDoc& shown, const std::vector<SeenSpec>& seen,
    const std::function<bool(std::string_view path, std::string_view field, const Bytes&)>& keeps,
    BlobSink& blobs, BlobSource& source);

/// Returns the value with the bytes of its blobs inline, or nothing if one is missing; adds the
/// missing ones to `missing`.
[[nodiscard]] std::optional<Bytes> encodedInline(const FieldValue& value, BlobSource& source,
                                                 std::vector<Hash>& missing);

}  // namespace usdlive::client
