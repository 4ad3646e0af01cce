// Checks control messages by reading them as their receiver does.
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive {

Result<std::string> encodeChecked(const ControlMessage& message) {
    std::string control = encodeControl(message);
    const auto read = decodeControl(control);
    if (!read) return tl::unexpected(read.error());
    if (*read == message) return control;
    return fail(ErrorCode::MalformedControl,
                "a text is not UTF-8 or longer than 64 KiB, or a number is not finite");
}

Result<void> checkPresence(const Presence& presence) {
    constexpr std::size_t kMatrix = 16;
    if (!presence.camera.empty() && presence.camera.size() != kMatrix)
        return fail(ErrorCode::MalformedControl, "a camera is a matrix of 16 numbers, and not of " +
                                                     std::to_string(presence.camera.size()));
    const std::size_t bytes = encodeControl(ShowPresence{presence}).size();
    if (bytes <= kMaxPresenceBytes) return {};
    return fail(ErrorCode::TransactionTooLarge, "a presence has at most " +
                                                    std::to_string(kMaxPresenceBytes) +
                                                    " bytes, and not " + std::to_string(bytes));
}

}  // namespace usdlive
