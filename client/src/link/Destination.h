// The server to which a user connects, and the user's name there.
#pragma once

#include <string>

#include "transport/Connection.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Returns `given`; if it is empty, the name with which the user joined the server (AC2); if there
/// is none, the name of the system. Reads a file. Error: InvalidConfiguration names it.
[[nodiscard]] Result<UserName> nameAt(const ServerAddress& server, const std::string& given);

/// A server, and the name under which the user acts there.
struct Destination {
    ServerAddress address;
    UserName user;
};

/// Returns where to connect. An invitation is exchanged for a token first, which waits for the
/// server. `user` and `token` may be empty: then those that are known for the server. Errors:
/// InvalidArgument, and those of nameAt() and of the exchange.
[[nodiscard]] Result<Destination> destinationOf(const std::string& url, const std::string& user,
                                                const std::string& token);

/// Checks names with which the server would refuse every connection. Error: InvalidArgument (they
/// cannot be sent).
[[nodiscard]] Result<void> checkNames(const UserName& user, const std::string& application);

}  // namespace usdlive::client
