// Control messages that a server sends: their lists are longer than those of a client.
#pragma once

#include <cstddef>
#include <string_view>

#include "usdlive/common/protocol/Control.h"

namespace usdlive {

/// The largest control message of a server, in bytes. It fits into a frame (FR2).
inline constexpr std::size_t kMaxServerControlBytes = 60 * 1024 * 1024;
/// The largest control message that is made of several layer states or presences, in bytes, unless
/// one of them is larger.
inline constexpr std::size_t kUpdateBytes = 4 * 1024 * 1024;
/// FI5: the most layers of a project, and the most bytes of their names. A list of all of them, and
/// of their states, fits into a control message.
inline constexpr std::size_t kMaxLayers = 150'000;
inline constexpr std::size_t kMaxLayerNameBytes = 24 * 1024 * 1024;

/// Does the same as decodeControl(), with the limit for messages of a server.
[[nodiscard]] Result<ControlMessage> decodeServerControl(std::string_view json);

}  // namespace usdlive
