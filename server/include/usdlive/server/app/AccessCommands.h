// `usdlive access`: explains the access rules of a project, on the machine of the server.
#pragma once

namespace usdlive::server {

/// The name of this program when `usdlive access` starts it.
inline constexpr const char* kAccessCommands = "usdlive access";

/// Prints the rules of a project, or what a user may write at a place and which rule decides.
/// Returns the exit code: 1 after an error of a file, 2 after one of the words.
[[nodiscard]] int runAccessCommand(int argc, const char* const* argv);

}  // namespace usdlive::server
