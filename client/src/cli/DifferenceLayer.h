// Differences between two contents of a layer, as a layer.
#pragma once

#include <optional>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive::cli {

/// Returns a layer with the opinions that `edits` have set, as `to` has them: over the content
/// before, it gives that of `to`, except for what was removed, moved or placed. `edits`: of
/// difference().
[[nodiscard]] LayerDoc differenceLayer(const LayerDoc& to, const std::vector<Edit>& edits);
/// Returns whether a layer can say what the edit does.
[[nodiscard]] bool isInDifferenceLayer(const EditAction& action);

/// Returns what `doc` has in the place of what the edit sets or erases; nothing if that is nothing,
/// or the edit does neither.
[[nodiscard]] std::optional<FieldValue> replacedBy(const LayerDoc& doc, const Edit& edit);

}  // namespace usdlive::cli
