// The verbs that take work back.
#pragma once

#include <string>

#include "cli/Commands.h"
#include "cli/Replay.h"

namespace usdlive::cli {

struct RevertOptions : Common {
    Revision first = 0, last = 0;  ///< 0: no bound
    CommitFilter filter;           ///< its layer is that of the target
    bool dryRun = false;
};
struct RestoreOptions : Common {
    RevisionWord to;
    std::string path;  ///< in the only layer: only the spec and everything below it
    bool dryRun = false;
};

/// Takes chosen commits back, in a new commit. What others have written since stays and is printed.
Result<void> revert(const RevertOptions& options);
/// Gives layers, or all that have changed since, the content of then, in a new commit.
Result<void> restore(const RestoreOptions& options);

}  // namespace usdlive::cli
