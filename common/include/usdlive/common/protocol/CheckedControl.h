// Checks control messages that contain what a caller has chosen, before they are sent.
#pragma once

#include <string>
#include <string_view>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive {

inline constexpr std::size_t kMaxPresenceBytes = 64 * 1024;

/// FR20: the most bytes and values of a control message of a client. A larger one would delay the
/// server's other sessions. Error: MalformedControl.
[[nodiscard]] Result<void> checkClientControl(std::string_view json);

/// Encodes a message of a client that the server reads as it is. Error: MalformedControl, if the
/// server would end the session over it, or read something else: a message that is too large, a
/// text that is not UTF-8 or too long, a number that is not finite. A message of values of this
/// process alone needs no check.
[[nodiscard]] Result<std::string> encodeChecked(const ControlMessage& message);

/// PS1: what a presence holds, without its encoding. Errors: MalformedControl (a camera that is no
/// matrix), TransactionTooLarge (more than kMaxPresenceBytes).
[[nodiscard]] Result<void> checkPresence(const Presence& presence);

}  // namespace usdlive
