#pragma once

#include <memory>
#include <string>

#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

enum class LogFormat { Text, Json };

/// Writes lines to stderr. `level` is one of kLogLevels.
inline constexpr const char* kLogLevels[] = {"debug", "info", "warning", "error"};
[[nodiscard]] std::unique_ptr<Log> createSpdLog(const std::string& level, LogFormat format);

}  // namespace usdlive::server
