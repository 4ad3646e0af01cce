// Locks of layers, and mutes for all users, as edits of a layer's root.
#pragma once

#include <functional>

#include "usd/live/EditorFrame.h"

namespace usdlive::client {

/// Locks and unlocks live layers (LK1), and mutes and unmutes layers for all users (MU1). The
/// layers themselves store this, so the class has no state.
class LocksAndMutes {
public:
    LocksAndMutes(LiveSet& layers, EditorFrame& frame, Session& session)
        : layers_(layers), frame_(frame), session_(session) {}

    Result<void> setLocked(const LayerId& id, bool locked, const std::function<void()>& alongside);
    Result<void> setGloballyMuted(const LayerId& root, const LayerId& layer, bool muted);

private:
    [[nodiscard]] Result<LiveLayer*> filled(const LayerId& id) const;

    LiveSet& layers_;
    EditorFrame& frame_;
    Session& session_;
};

}  // namespace usdlive::client
