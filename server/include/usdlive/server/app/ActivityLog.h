#pragma once

#include "usdlive/server/app/LogLimit.h"
#include "usdlive/server/project/ports/Activity.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// Who did what, as lines of the server's log. Somebody who does the same again and again fills no
/// disk (LogLimit).
class ActivityLog final : public ports::Activity {
public:
    explicit ActivityLog(Log& log) : log_(log) {}
    void happened(const Happening& happening) override;

private:
    Log& log_;
    LogLimit limit_;
};

}  // namespace usdlive::server
