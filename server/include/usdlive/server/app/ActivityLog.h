// Writes the actions of users to the server's log.
#pragma once

#include "usdlive/server/app/LogLimit.h"
#include "usdlive/server/project/ports/Activity.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// Writes the actions of users to the server's log. Limits repeated lines, so that they do not fill
/// the disk (LogLimit).
class ActivityLog final : public ports::Activity {
public:
    explicit ActivityLog(Log& log) : log_(log) {}
    void record(const ActivityEvent& event) override;

private:
    Log& log_;
    LogLimit limit_;
};

}  // namespace usdlive::server
