// `usdlive audit`: reads and checks the audit log, on the machine of the server.
#pragma once

namespace usdlive::server {

/// The name of this program when `usdlive audit` starts it.
inline constexpr const char* kAuditCommand = "usdlive audit";

/// Returns the exit code: 1 if the audit log is damaged or cannot be read, 2 after an error of the
/// words.
[[nodiscard]] int runAuditCommand(int argc, const char* const* argv);

}  // namespace usdlive::server
