// Requests and searches of the history as the package describes them.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <string>

#include "usdlive/client/history/History.h"
#include "usdlive/common/protocol/Requests.h"

namespace usdlive {

// Call them with the interpreter's lock. They raise Python exceptions.

/// Returns a request of this type, as in PROTOCOL.md: "createCheckpoint". Raises InvalidArgument.
[[nodiscard]] AnyRequest requestFrom(const std::string& type, const nanobind::dict& fields);

/// Returns the query that the dictionary of _connection.py describes. Raises InvalidArgument and
/// the errors of parseLayerId().
[[nodiscard]] client::LogQuery logQueryFrom(const nanobind::dict& query, Revision before,
                                            std::size_t limit);

}  // namespace usdlive
