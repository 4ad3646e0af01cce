// `usdlive backup`: copies a project while it is served, on the machine of the server.
#pragma once

namespace usdlive::server {

/// The name of this program when `usdlive backup` starts it.
inline constexpr const char* kBackupCommand = "usdlive backup";

/// Returns the exit code: 1 if there is no backup, 2 after an error of the words.
[[nodiscard]] int runBackupCommand(int argc, const char* const* argv);

}  // namespace usdlive::server
