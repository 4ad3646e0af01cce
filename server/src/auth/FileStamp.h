// Tells whether a file was replaced or changed.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace usdlive::server {

/// Returns a value that differs when the file was replaced or written; nothing if it is not there.
[[nodiscard]] std::optional<std::string> changeStampOf(const std::filesystem::path& path);

}  // namespace usdlive::server
