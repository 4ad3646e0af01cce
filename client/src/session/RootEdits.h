// Edits of a layer's root that lock the layer, or mute others for all users.
#pragma once

#include <cstdint>
#include <vector>

#include "session/Session.h"

namespace usdlive::client {

// The layers themselves store locks and mutes. The edits are for what the session shows, so that
// they are none if nothing changes. Precondition: the session shows the layer that they edit.

/// Returns the edits that lock the layer in the user's own name, or unlock it (LK1, LK2). Error:
/// InvalidArgument (checkLockable()).
[[nodiscard]] Result<std::vector<EditAction>> lockEdits(const Session& session,
                                                        const LayerId& layer, bool locked,
                                                        std::int64_t nowMs);

/// Returns the edits of `root` that mute or unmute `layer` on its stages (MU1). Errors:
/// InvalidArgument, LayerNotFound.
[[nodiscard]] Result<std::vector<EditAction>> muteEdits(const Session& session, const LayerId& root,
                                                        const LayerId& layer, bool muted);

/// Returns the layers that `root` mutes on its stages; none if the session does not show it.
[[nodiscard]] std::set<LayerId> globallyMuted(const Session& session, const LayerId& root);

}  // namespace usdlive::client
