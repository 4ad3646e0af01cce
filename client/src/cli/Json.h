// The JSON output of the commands.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "usdlive/client/session/Undo.h"
#include "usdlive/common/layer/Blobs.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::cli {

using Json = nlohmann::ordered_json;

/// Returns the content of a field: numbers as numbers, vectors and arrays as arrays, matrices as
/// arrays of rows, quaternions as [i, j, k, real], a block as null, time samples as [[time, value],
/// ...]. Numbers that JSON does not have are the texts "nan", "inf" and "-inf". Big values are read
/// from `blobs`; a missing one is {"blob": hash, "bytes": size}.
[[nodiscard]] Json toJson(const FieldValue& value, BlobSource& blobs);

/// Returns the type of a field's content as in .usda: `double`, `float3[]`, `dictionary`.
[[nodiscard]] std::string typeText(const FieldValue& value);

/// Returns a commit with the edits of `layer`, or all edits if it is empty.
[[nodiscard]] Json toJson(const Commit& commit, const LayerId& layer, BlobSource& blobs);
/// Returns {"specs": [{"path", "kind", "fields": {name: {"type", "value"}}}]}, parents before
/// children.
[[nodiscard]] Json toJson(const LayerDoc& doc, BlobSource& blobs);
/// Returns the prims and variants as a tree: {"name", "path", "type", "specifier", "children":
/// [...]}.
[[nodiscard]] Json treeToJson(const LayerDoc& doc);
[[nodiscard]] Json toJson(const LayerState& state);
[[nodiscard]] Json toJson(const Presence& presence);
[[nodiscard]] Json toJson(const client::KeptByUndo& kept);
/// The fields of an answer, in the order of its declaration, without the number of the request.
[[nodiscard]] Json answerToJson(const ControlMessage& answer);

/// Returns the JSON on one line. Replaces bytes that are not UTF-8.
[[nodiscard]] std::string line(const Json& json);

}  // namespace usdlive::cli
