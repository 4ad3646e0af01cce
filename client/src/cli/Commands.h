// The verbs of `usdlive`. They print to standard output; the caller prints errors.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "cli/ComposedCommands.h"
#include "cli/Target.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

/// The options of every verb.
struct Common {
    Target target;
    std::string user;  ///< acts in the name of this user; empty: see client::nameAt()
    bool json = false;
};
struct ListOptions : Common {
    bool states = false;   ///< prints the state of each layer
    bool skipped = false;  ///< lists files that are not served, with the reasons, instead of layers
};
struct CatOptions : Common {
    Revision revision = 0;
    std::string checkpoint;  ///< used instead of a revision
};
/// A verb that composes a stage.
struct StageCommandOptions : CatOptions {
    bool composed = false;  ///< `tree` and `dump`: show `stage`
    ComposedOptions stage;
};
struct CompactOptions : Common {
    std::optional<std::uint64_t> days;  ///< not set: the server's setting
};
struct UnlockOptions : Common {
    bool all = false;
};
struct SaveOptions : Common {
    bool force = false;
};
struct MuteOptions : Common {
    LayerId root;  ///< root layer of the stages on which the target's layers are muted
};
struct CheckpointOptions : Common {
    std::string name;
};
struct UploadOptions : Common {
    std::string file;  ///< on this machine
    std::string path;  ///< in the project
    bool overwrite = false;
};

struct ServerOnly {
    client::ServerAddress server;
};

Result<void> list(const ListOptions& options);
/// Lists the connected users with selection, edit target and time.
Result<void> who(const Common& options);
Result<void> cat(const CatOptions& options);
Result<void> tree(const CatOptions& options);
/// Prints new commits until SIGINT or SIGTERM.
Result<void> watch(const Common& options);
/// Locks or unlocks each layer. An error names the holder of the lock.
Result<void> setLocked(const Common& options, bool locked);
/// Removes all locks of layers and specs, and all mutes. Only for administrators.
Result<void> unlockAll(const Common& options);
Result<void> save(const SaveOptions& options);
Result<void> reload(const Common& options);
/// Makes a file of this machine that is no layer a file of the project.
Result<void> upload(const UploadOptions& options);
/// Gives the current revision of the project a name.
Result<void> createCheckpoint(const CheckpointOptions& options);
Result<void> listCheckpoints(const Common& options);
/// Asks the server to replace old commits by a base.
Result<void> compact(const CompactOptions& options);
/// Prints the disk space of the server's store.
Result<void> stat(const Common& options);
Result<void> setMuted(const MuteOptions& options, bool muted);
/// Forgets the certificate and the token of a server, and says whether there was one.
Result<void> forget(const ServerOnly& options);
/// Signs in at a server with its issuer, in a browser.
Result<void> login(const ServerOnly& options);
/// Joins a server with an invitation, which is read from the standard input if it is empty.
Result<void> join(const std::string& invitation);
/// Replaces this process by `usdlive-server`, for `serve`, `user` and `access`. The first argument
/// is the verb. Returns only if that fails.
Error runServer(char** arguments);
/// Replaces this process by the gateway of the page: `python -m usdlive.page`, with the arguments
/// after the first one. USDLIVE_PYTHON names the Python; the default is python3. Returns only if
/// that fails.
Error runPage(char** arguments);

}  // namespace usdlive::cli
