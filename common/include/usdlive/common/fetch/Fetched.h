// A value, or the reason why there is none.
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace usdlive::fetch {

/// Why something could not be fetched.
struct Failure {
    std::string cause;           ///< can follow "cannot open ...: "
    unsigned status = 0;         ///< the HTTP status; 0: there was no complete answer
    int error = 0;               ///< the errno that ended the connection, if one did
    bool isUnreachable = false;  ///< no connection, or no answer within the time
};

template <class T>
using Fetched = tl::expected<T, Failure>;

/// `return failed("the path leads out of the server");`
[[nodiscard]] inline tl::unexpected<Failure> failed(std::string cause, unsigned status = 0) {
    return tl::unexpected(Failure{std::move(cause), status});
}

}  // namespace usdlive::fetch
