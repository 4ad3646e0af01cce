// `usdlive access`, `grant`, `deny` and `revoke`: the access rules of a project, on the machine of
// the server.
#pragma once

#include <optional>

namespace usdlive::server {

/// Runs one of the commands if argv[0] names it, for example "usdlive grant". Returns the exit
/// code: 1 after an error of a file, 2 after one of the words.
[[nodiscard]] std::optional<int> runAccessCommand(int argc, const char* const* argv);

}  // namespace usdlive::server
