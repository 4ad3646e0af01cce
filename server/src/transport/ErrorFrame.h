// Encodes the error that ends a session.
#pragma once

#include "project/SharedFrame.h"

namespace usdlive::server {

/// Returns the last frame of a session that ends with an error.
[[nodiscard]] inline SharedBytes errorFrame(const Error& error) {
    return sharedFrame(
        ErrorMessage{std::string(errorName(error.code)), error.message, true, {}, {}});
}

/// Returns the error that clients get for a bug of the server.
[[nodiscard]] inline Error internal() {
    return {ErrorCode::Internal, std::string(errorText(ErrorCode::Internal))};
}

}  // namespace usdlive::server
