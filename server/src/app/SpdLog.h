// Creates the log that writes to stderr.
#pragma once

#include <memory>
#include <string>

#include "transport/Log.h"

namespace usdlive::server {

enum class LogFormat { Text, Json };

/// Returns a log that writes lines to stderr. `level` is one of kLogLevels. Each line contains
/// `project` unless it is empty.
inline constexpr const char* kLogLevels[] = {"debug", "info", "warning", "error"};
[[nodiscard]] std::unique_ptr<Log> createSpdLog(const std::string& level, LogFormat format,
                                                const std::string& project = {});

}  // namespace usdlive::server
