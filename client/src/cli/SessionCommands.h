// The verbs for live sessions of a project.
#pragma once

#include <string>
#include <vector>

#include "cli/Commands.h"
#include "usdlive/client/lines/ProjectSessions.h"

namespace usdlive::cli {

struct SessionOptions : Common {
    std::string verb, name;
    std::string from;     ///< `create`: a revision or checkpoint; empty: the newest revision
    bool dryRun = false;  ///< `merge`, `update`
    bool keep = false;    ///< `merge`: do not end the session
    client::Take take = client::Take::Undecided;  ///< `merge`, `update`: for all conflicts
    /// `merge`, `update`: specs with all below, before `take`.
    std::vector<std::string> mainPaths, sessionPaths;
};

/// Creates, lists, ends, restores, deletes, merges and updates live sessions.
Result<void> liveSession(const SessionOptions& options);

}  // namespace usdlive::cli
