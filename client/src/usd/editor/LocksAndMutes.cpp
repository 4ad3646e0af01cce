// Locks layers, and mutes them for all users, by edits of a layer's root.
#include "usd/editor/LocksAndMutes.h"

#include <utility>

#include "basics/Clocks.h"
#include "session/RootEdits.h"

namespace usdlive::client {

Result<LiveLayer*> LocksAndMutes::filled(const LayerId& id) const {
    LiveLayer* live = layers_.find(id);
    if (!live || !live->isFilled())
        return fail(ErrorCode::LayerNotOpen, id.value + " is not open here");
    return live;
}

Result<void> LocksAndMutes::setLocked(const LayerId& id, bool locked,
                                      const std::function<void()>& alongside) {
    const auto live = filled(id);
    if (!live) return tl::unexpected(live.error());
    frame_.seal(layers_, session_);
    auto edits = lockEdits(session_, id, locked, wallClockMs());
    if (!edits) return tl::unexpected(edits.error());
    frame_.author(layers_, session_, **live, std::move(*edits), alongside);
    return {};
}

Result<void> LocksAndMutes::setGloballyMuted(const LayerId& root, const LayerId& layer,
                                             bool muted) {
    const auto live = filled(root);
    if (!live) return tl::unexpected(live.error());
    frame_.seal(layers_, session_);
    auto edits = muteEdits(session_, root, layer, muted);
    if (!edits) return tl::unexpected(edits.error());
    frame_.author(layers_, session_, **live, std::move(*edits));
    return {};
}

}  // namespace usdlive::client
