// Writes the actions of users to the server's log and to the audit log.
#pragma once

#include <string>

#include "app/AuditLog.h"
#include "app/LogLimit.h"
#include "project/ports/Activity.h"
#include "transport/Log.h"

namespace usdlive::server {

/// Writes the actions of users in one project to the server's log and to the audit log. Both limit
/// repeated lines, so that they do not fill the disk (LogLimit).
class ActivityLog final : public ports::Activity {
public:
    ActivityLog(std::string project, Log& log, AuditLog& audit)
        : project_(std::move(project)), log_(log), audit_(audit) {}
    void record(const ActivityEvent& event) override;

private:
    const std::string project_;
    Log& log_;
    AuditLog& audit_;
    LogLimit limit_;
};

}  // namespace usdlive::server
