// The name under which a user acts at a server.
#pragma once

#include <string>

#include "transport/Connection.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Returns `given`; if it is empty, the name with which the user joined the server (AC2); if there
/// is none, the name of the system. Reads a file. Error: InvalidConfiguration names it.
[[nodiscard]] Result<UserName> nameAt(const ServerAddress& server, const std::string& given);

}  // namespace usdlive::client
