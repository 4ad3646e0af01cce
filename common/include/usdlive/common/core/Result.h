// Errors and results of functions that can fail.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

#include "usdlive/common/core/ErrorCode.h"  // generated from common/protocol/errors.json

namespace usdlive {

/// An error that can be shown, sent and compared by its code.
struct Error {
    ErrorCode code{};
    std::string message;  ///< one sentence that names what failed and where; never empty

    bool operator==(const Error&) const = default;
};

template <class T>
using Result = tl::expected<T, Error>;

/// `return fail(ErrorCode::LayerNotFound, "no layer " + id);`
[[nodiscard]] inline tl::unexpected<Error> fail(ErrorCode code, std::string message) {
    return tl::unexpected(Error{code, std::move(message)});
}

}  // namespace usdlive
