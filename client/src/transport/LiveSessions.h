// Requests to a server about the live sessions of a project.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "transport/Connection.h"

namespace usdlive::client {

/// A live session as its server knows it (LV3).
struct ListedLiveSession {
    std::string name;
    std::string creator;
    std::int64_t timeMs = 0;  ///< when it was created, in milliseconds since 1970
    Revision revision = 0;    ///< the newest one that it shares with the main line
    bool isEnded = false;     ///< nobody can connect; `restore` opens it again
    Revision merged = 0;      ///< revision of the main line that has its changes; 0: none
    std::string error = {};   ///< the reason why it cannot be opened; empty: it can
};

/// Returns the address of a live session of the project at `server`, and that of the project.
[[nodiscard]] ServerAddress liveSessionAddress(const ServerAddress& server,
                                               const std::string& name);
[[nodiscard]] ServerAddress mainLineAddress(const ServerAddress& server);

/// Returns the live sessions of the project, by name. Blocks for at most `timeout`. Errors:
/// NotConnected; InvalidArgument if the server has no such project, or is an older one.
[[nodiscard]] Result<std::vector<ListedLiveSession>> listLiveSessions(
    const ServerAddress& server, std::chrono::milliseconds timeout);

/// Changes a live session: `verb` is `create`, `end`, `restore` or `delete`. `user`: who does it,
/// if the server asks nobody to sign in. `merged`: with `end`, the revision of the main line that
/// has its changes. Blocks for at most `timeout`; then it may be done or not. Errors: NotConnected;
/// InvalidArgument with the server's reason.
[[nodiscard]] Result<ListedLiveSession> changeLiveSession(
    const ServerAddress& server, const std::string& name, std::string_view verb,
    const UserName& user, std::chrono::milliseconds timeout, Revision merged = 0);

}  // namespace usdlive::client
