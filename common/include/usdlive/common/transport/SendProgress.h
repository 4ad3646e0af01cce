// Measures how much of what was sent a TCP peer has taken.
#pragma once

#include <cstdint>
#include <optional>

namespace usdlive {

/// The state of a socket's sending side, in bytes since the connection was opened.
struct SendProgress {
    std::uint64_t acknowledged = 0;  ///< the peer's system has received them
    std::uint64_t waiting = 0;       ///< written to the socket and not acknowledged
};

/// Returns nothing if the system does not know, for example for a closed socket.
[[nodiscard]] std::optional<SendProgress> sendProgress(int socket);

/// Makes writes to the socket wait while more than `bytes` were not sent, so that a message that is
/// written now is not behind megabytes in the system's buffer.
void limitUnsent(int socket, int bytes);

}  // namespace usdlive
