#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// A layer's lock, as it stands in its own custom layer data, where Kit looks for it:
/// `customLayerData:omni_layer:locked`, and beside it, ours, `locked_by` and `locked_at`. It is
/// content like any other: it travels as edits, is saved with the layer, and is undone with them.
/// The server holds everybody to it (LK1).
struct LayerLock {
    bool locked = false;
    UserName holder;        ///< empty: nobody is named
    std::int64_t atMs = 0;  ///< since 1970, by the holder's clock
    bool operator==(const LayerLock&) const = default;
};

[[nodiscard]] LayerLock lockOf(const LayerDoc& doc);

/// What makes the layer's lock this one: edits of the pseudo-root.
[[nodiscard]] std::vector<EditAction> lockEdits(const LayerLock& lock);
/// The same for a layer with this content: nothing if the user holds the lock already, or if there
/// is none to release.
[[nodiscard]] std::vector<EditAction> lockEdits(const LayerDoc& doc, const LayerLock& lock);

/// What empties the map of locked layers that Kit keeps in a root layer under the same key. The
/// server holds nobody to it; Kit's editors mind it.
[[nodiscard]] std::vector<EditAction> lockMapEdits(const LayerDoc& root);

/// Does the action, of the pseudo-root, concern nothing but the lock?
[[nodiscard]] bool isLockEdit(const EditAction& action);
/// May it change the lock?
[[nodiscard]] bool touchesLock(const EditAction& action);
/// Does it change any custom layer data, where also spec locks and muteness stand?
[[nodiscard]] bool touchesLayerData(const EditAction& action);

}  // namespace usdlive
