// The port to the log of what users do.
#pragma once

#include <string>
#include <string_view>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// A user did something, or was refused it. `what` is one of a few fixed texts; `layer` and
/// `detail` come from clients and may be empty.
struct ActivityEvent {
    std::string_view what;
    const UserName& user;
    LayerId layer = {};
    std::string detail = {};
};

namespace ports {

/// The log of what users did. Nothing depends on it.
class Activity {
public:
    virtual ~Activity() = default;
    virtual void record(const ActivityEvent& event) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
