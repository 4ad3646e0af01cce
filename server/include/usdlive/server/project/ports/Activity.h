#pragma once

#include <string>
#include <string_view>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// Somebody did something, or was refused it. `what` is a few words that never vary; `layer` and
/// `detail` may be empty, and hold what clients sent.
struct Happening {
    std::string_view what;
    const UserName& user;
    LayerId layer = {};
    std::string detail = {};
};

namespace ports {

/// The log of who did what, which decides nothing.
class Activity {
public:
    virtual ~Activity() = default;
    virtual void happened(const Happening& happening) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
