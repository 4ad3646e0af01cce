#pragma once

#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

/// Returns the last frame of a session that ends with an error.
[[nodiscard]] inline SharedBytes errorFrame(const Error& error) {
    ErrorMessage message{std::string(errorName(error.code)), error.message, true, {}, {}};
    return std::make_shared<const Bytes>(encodeFrame(ControlFrame{encodeControl(message)}));
}

/// Returns the error that clients get for a bug of the server.
[[nodiscard]] inline Error internal() {
    return {ErrorCode::Internal, std::string(errorText(ErrorCode::Internal))};
}

}  // namespace usdlive::server
