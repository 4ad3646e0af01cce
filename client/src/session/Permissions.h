// Decides what this user may do now, by role, access rules and locks, as the server has sent them.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "session/Session.h"

namespace usdlive::client {

/// Returns who has locked the layer, if this keeps the user from editing it (LK1).
[[nodiscard]] std::optional<UserName> foreignLock(const Session& session, const LayerId& layer);

/// Returns whether the user may write something in the layer. Precondition: the session knows the
/// project.
[[nodiscard]] bool mayWriteIn(const Session& session, const LayerId& layer);

// See Client::mayEdit() and Client::mayDo().
[[nodiscard]] Result<Permission> mayEdit(const Session& session, const LayerId& layer,
                                         const std::string& path, std::string_view kind);
[[nodiscard]] Result<Permission> mayDo(const Session& session, std::string_view action,
                                       const LayerId& place);

}  // namespace usdlive::client
