// The lock of a layer.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// A layer's lock. It is kept in the layer's own custom layer data, where Kit reads it:
/// `customLayerData:omni_layer:locked`, with our additions `locked_by` and `locked_at`. It is
/// content like any other: it travels as edits, is saved with the layer and is undone with its
/// edits. The server enforces it for everybody (LK1).
struct LayerLock {
    bool locked = false;
    UserName holder;        ///< empty: the lock names no holder
    std::int64_t atMs = 0;  ///< milliseconds since 1970, by the holder's clock
    bool operator==(const LayerLock&) const = default;
};

[[nodiscard]] LayerLock lockOf(const LayerDoc& doc);

/// Returns the edits of the pseudo-root that set the layer's lock to this one.
[[nodiscard]] std::vector<EditAction> lockEdits(const LayerLock& lock);
/// Returns the edits for a layer with this content: none if the user holds the lock already, or if
/// there is no lock to release.
[[nodiscard]] std::vector<EditAction> lockEdits(const LayerDoc& doc, const LayerLock& lock);

/// Returns an error if the layer has no lock of its own: as the root layer of a stage, it keeps at
/// this place which layers Kit has locked.
[[nodiscard]] Result<void> checkLockable(const LayerId& layer, const LayerDoc& doc);

/// Returns true if the action, of the pseudo-root, changes only the lock.
[[nodiscard]] bool isLockEdit(const EditAction& action);
/// Returns true if the action may change the lock.
[[nodiscard]] bool touchesLock(const EditAction& action);
/// Returns true if the action changes custom layer data, which also holds spec locks and muteness.
[[nodiscard]] bool touchesLayerData(const EditAction& action);

}  // namespace usdlive
