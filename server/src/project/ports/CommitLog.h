// The port to the log of one line of history.
#pragma once

#include "project/CommitStore.h"

namespace usdlive::server::ports {

/// The log that stores the commits of one line of history.
class CommitLog {
public:
    virtual ~CommitLog() = default;
    /// Appends the next commit; returns at once. Commits are appended in the order of the calls,
    /// and may be grouped. Answered by Project::appended() when commits are durable, or by
    /// appendFailed(), after which the commits passed so far are not appended any more.
    virtual void append(CommitRecord commit) = 0;
};

}  // namespace usdlive::server::ports
