// Checks control messages that contain what a caller has chosen, before they are sent.
#pragma once

#include <string>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive {

inline constexpr std::size_t kMaxPresenceBytes = 64 * 1024;

/// Encodes a message that the receiver reads as it is. Error: MalformedControl, if the receiver
/// would end the session over it, or read something else: a text that is not UTF-8 or too long, a
/// number that is not finite. A message of values of this process alone needs no check.
[[nodiscard]] Result<std::string> encodeChecked(const ControlMessage& message);

/// PS1: what a presence holds, without its encoding. Errors: MalformedControl (a camera that is no
/// matrix), TransactionTooLarge (more than kMaxPresenceBytes).
[[nodiscard]] Result<void> checkPresence(const Presence& presence);

}  // namespace usdlive
