// Shared functions of the commands for administrators, which run on the server's machine.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "usdlive/common/core/Result.h"

namespace CLI {
class App;
}

namespace usdlive::server {

/// Parses the words and calls `chosen`. Prints errors. Returns the exit code: 1 after an error of
/// `chosen` or of standard output, 2 after one of the words.
[[nodiscard]] int runAdminCommand(CLI::App& app, int argc, const char* const* argv,
                                  const std::function<Result<void>()>& chosen);

/// Returns the folder whose `.usdlive` has the accounts for a project: its own, or the one of
/// `--projects` above it. Without accounts it is `folder`.
[[nodiscard]] std::filesystem::path accountsFolderOf(const std::filesystem::path& folder);

/// Returns the name that a project has on its server.
[[nodiscard]] std::string projectNameOf(const std::filesystem::path& folder);

/// Records what a command has done in the audit log of the accounts' folder. `event` is a fixed
/// text. Error: StorageFailed; the command has done it nevertheless.
[[nodiscard]] Result<void> recordCommand(const std::filesystem::path& accountsFolder,
                                         std::string_view event, const std::string& detail,
                                         const std::string& project = "");

}  // namespace usdlive::server
