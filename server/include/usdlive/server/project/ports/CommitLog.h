// The port to the log of one line of history.
#pragma once

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server::ports {

/// Where one line of history is kept.
class CommitLog {
public:
    virtual ~CommitLog() = default;
    /// Appends, in order; answered by appended() or appendFailed().
    virtual void append(CommitRecord commit) = 0;
};

}  // namespace usdlive::server::ports
