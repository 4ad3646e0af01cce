// The port to the activity log: what users have done.
#pragma once

#include <string>
#include <string_view>

#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// An action of a user, or its refusal. Not valid after record() has returned.
struct ActivityEvent {
    std::string_view what;    ///< one of a few fixed texts, for example "layer saved"
    const UserName& user;     ///< empty: nobody who is signed in, then there is a detail
    LayerId layer = {};       ///< may be empty; from a client, so any text
    std::string detail = {};  ///< may be empty; from a client, so any text
};

namespace ports {

/// Receives the actions of users, for a log. The project does not depend on what it does with them.
class Activity {
public:
    virtual ~Activity() = default;
    /// Called in the order of the actions. Must not block.
    virtual void record(const ActivityEvent& event) = 0;
};

}  // namespace ports
}  // namespace usdlive::server
