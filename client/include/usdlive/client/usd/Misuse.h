// The exception for wrong calls of the client library.
#pragma once

#include <stdexcept>
#include <utility>

#include "usdlive/common/core/Result.h"

namespace usdlive {

/// A call that is a mistake of the caller's, for example on another thread. Nothing was done.
class Misuse : public std::logic_error {
public:
    explicit Misuse(Error error) : std::logic_error(error.message), error(std::move(error)) {}
    const Error error;
};

}  // namespace usdlive
