// What each verb of `usdlive` does. The verbs print to standard output; the caller shows errors.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "Target.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::cli {

/// What every verb has.
struct Common {
    Target target;
    std::string user;  ///< in whose name; empty: the user of the system
    bool json = false;
};
struct ListOptions : Common {
    bool states = false;   ///< beside each layer what is known of it
    bool skipped = false;  ///< instead of layers, files that are none and why
};
struct CatOptions : Common {
    Revision revision = 0;
    std::string checkpoint;  ///< instead of a revision
};
struct LogOptions : Common {
    Revision from = 0;  ///< 0: the latest
    std::size_t limit = 20;
    bool all = false;  ///< every edit of a commit
};
struct CompactOptions : Common {
    std::optional<std::uint64_t> days;  ///< nothing: as the server was told
};
struct UnlockOptions : Common {
    bool all = false;
};
struct SaveOptions : Common {
    bool force = false;
};
struct MuteOptions : Common {
    LayerId root;  ///< of the stages; the target's layers are muted there
};
struct CheckpointOptions : Common {
    std::string name;
};

Result<void> list(const ListOptions& options);
/// Who is connected, with selection, edit target and time.
Result<void> who(const Common& options);
Result<void> cat(const CatOptions& options);
Result<void> tree(const CatOptions& options);
Result<void> log(const LogOptions& options);
/// Prints commits as they come, until SIGINT or SIGTERM.
Result<void> watch(const Common& options);
/// Locks or unlocks each layer. An error says who holds the lock.
Result<void> setLocked(const Common& options, bool locked);
/// Ends all locks of layers and specs, and all mutes; the server lets administrators.
Result<void> unlockAll(const Common& options);
Result<void> save(const SaveOptions& options);
Result<void> reload(const Common& options);
/// Names the present revision of the project.
Result<void> createCheckpoint(const CheckpointOptions& options);
Result<void> listCheckpoints(const Common& options);
/// Has the server replace old commits by what the layers held then.
Result<void> compact(const CompactOptions& options);
/// What takes the space of the server's disk.
Result<void> stat(const Common& options);
Result<void> setMuted(const MuteOptions& options, bool muted);
/// Becomes `usdlive-server`; returns only when that fails.
Error serve(char** arguments);

}  // namespace usdlive::cli
