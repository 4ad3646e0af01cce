// The verbs for live sessions of a project.
#pragma once

#include <string>
#include <vector>

#include "cli/Commands.h"
#include "session/LineMerge.h"

namespace usdlive::cli {

struct SessionOptions : Common {
    std::string verb, name;
    bool dryRun = false;                          ///< `merge`
    bool keep = false;                            ///< `merge`: do not end the session
    client::Side take = client::Side::Undecided;  ///< `merge`: for all conflicts
    std::vector<std::string> mainPaths,
        sessionPaths;  ///< `merge`: specs with all below, before `take`
};

/// Creates, lists, ends, restores, deletes and merges live sessions.
Result<void> liveSession(const SessionOptions& options);

}  // namespace usdlive::cli
