// Joins a server with an invitation.
#pragma once

#include <string>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/net/Invitation.h"

namespace usdlive::fetch {

struct JoinedServer {
    std::string user;  ///< the name of the user at this server
    std::string url;   ///< `ws://HOST:PORT` or `wss://HOST:PORT`
};

/// Exchanges the invitation for a token, and keeps it in KnownServers, so that all programs of this
/// user sign in at the server from now on (AC2). Blocks for at most 20 s. Any thread. Errors:
/// SignInRequired (the invitation was used already, or is too old), NotConnected (it can be used
/// again), InvalidConfiguration (the token cannot be kept).
[[nodiscard]] Result<JoinedServer> join(const Invitation& invitation);

}  // namespace usdlive::fetch
