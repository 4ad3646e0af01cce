#pragma once

#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

/// The last that a session hears.
[[nodiscard]] inline SharedBytes errorFrame(const Error& error) {
    ErrorMessage message{std::string(errorName(error.code)), error.message, true, {}, {}};
    return std::make_shared<const Bytes>(encodeFrame(ControlFrame{encodeControl(message)}));
}

/// Of who meets a bug of ours.
[[nodiscard]] inline Error internal() {
    return {ErrorCode::Internal, std::string(errorText(ErrorCode::Internal))};
}

}  // namespace usdlive::server
