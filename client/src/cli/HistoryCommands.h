// The verbs that read the history of a project.
#pragma once

#include <cstddef>
#include <string>

#include "cli/Commands.h"
#include "cli/Replay.h"

namespace usdlive::cli {

struct LogOptions : Common {
    Revision from = 0;  ///< 0: the latest commits
    std::size_t limit = 20;
    bool all = false;     ///< prints every edit of a commit
    CommitFilter filter;  ///< its layer is that of the target
};
struct BlameOptions : Common {
    std::string path;    ///< a spec, or a spec and a field: `/World/Ball.radius`, `/World.kind`
    bool below = false;  ///< also everything below the spec
};
struct DiffOptions : Common {
    RevisionWord from, to = "now";
    std::string path;      ///< only the spec and everything below it; empty: the whole layer
    bool asLayer = false;  ///< prints .usda
};
Result<void> log(const LogOptions& options);
/// Prints for each opinion who has made it, when, and what was there before.
Result<void> blame(const BlameOptions& options);
/// Prints what has changed in a layer between two moments.
Result<void> diff(const DiffOptions& options);
}  // namespace usdlive::cli
