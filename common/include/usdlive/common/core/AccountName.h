// Names of the accounts of this machine.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

namespace usdlive {

/// Returns the name of an account; nothing if the system knows none. The system may read a file for
/// it, or ask a directory service. Any thread.
[[nodiscard]] std::optional<std::string> accountName(uid_t account);

}  // namespace usdlive
