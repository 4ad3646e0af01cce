// Requests to a server about the live sessions of a project.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "transport/Connection.h"

namespace usdlive::client {

/// A merge of a live session and the main line, in one of both directions (LV7).
struct NotedMerge {
    bool isIntoMain = false;  ///< the main line has received what the session had; else reversed
    Revision from = 0;        ///< the newest revision that was merged, of the line that gave
    Revision into = 0;        ///< a revision of the line that received, before the merge's commit
    /// Whose commit after `into` is the merge: without that commit, there was none. Empty: nothing
    /// had to be changed.
    ClientId client = {};
    std::chrono::milliseconds age{};  ///< since it was noted
};

/// A live session as its server knows it (LV3).
struct ListedLiveSession {
    std::string name;
    std::string creator;
    std::int64_t timeMs = 0;  ///< when it was created, in milliseconds since 1970
    Revision revision = 0;    ///< the newest one that it shares with the main line
    Revision begin = 0;       ///< its own revision that has the content of `revision`
    bool isEnded = false;     ///< nobody can connect; `restore` opens it again
    Revision merged = 0;      ///< revision of the main line that has its changes; 0: none
    std::string error = {};   ///< the reason why it cannot be opened; empty: it can
    std::vector<std::string> users = {};  ///< the users that are in it
    std::vector<NotedMerge> merges = {};  ///< in the order in which they were noted
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
/// if the server asks nobody to sign in. `mainRevision`: with `create`, the revision of the main
/// line from which it is (0: the newest); with `end`, the one that has its changes (0: none).
/// Blocks for at most `timeout`; then it may be done or not. Errors: NotConnected; InvalidArgument
/// with the server's reason.
[[nodiscard]] Result<ListedLiveSession> changeLiveSession(
    const ServerAddress& server, const std::string& name, std::string_view verb,
    const UserName& user, std::chrono::milliseconds timeout, Revision mainRevision = 0);
/// Notes a merge that is about to be committed, after those that are known (LV7). Errors as above:
/// also if another one was noted meanwhile.
[[nodiscard]] Result<void> noteMerge(const ServerAddress& server, const std::string& name,
                                     const UserName& user, const NotedMerge& merge,
                                     std::size_t known, std::chrono::milliseconds timeout);

}  // namespace usdlive::client
