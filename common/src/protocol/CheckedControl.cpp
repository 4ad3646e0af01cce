// Checks control messages by reading them as their receiver does.
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive {

Result<void> checkClientControl(std::string_view json) {
    constexpr std::size_t kMostBytes = 4 * 1024 * 1024, kMostValues = 131'072;
    std::size_t values = 0;  // at most; also counts these characters in texts
    for (const char character : json)
        values += character == ',' || character == '[' || character == '{';
    if (json.size() <= kMostBytes && values <= kMostValues) return {};
    return fail(ErrorCode::MalformedControl,
                "a control message of a client has at most 4 MiB and 131,072 values");
}

Result<std::string> encodeChecked(const ControlMessage& message) {
    std::string control = encodeControl(message);
    if (auto fits = checkClientControl(control); !fits) return tl::unexpected(fits.error());
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
