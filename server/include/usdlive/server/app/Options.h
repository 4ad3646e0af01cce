#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/protocol/FrameParts.h"
#include "usdlive/server/app/SpdLog.h"

namespace usdlive::server {

/// What the command line and the configuration file say.
struct ServerOptions {
    std::vector<std::filesystem::path> folders;  ///< each a project
    std::filesystem::path projectsFolder;        ///< each of its subfolders a project; empty: none
    std::string host = "127.0.0.1";
    std::uint16_t port = 7447;
    std::filesystem::path portFile;
    std::vector<std::string> allowedOrigins;
    bool dds = false;
    std::string ddsInterface = "lo";
    std::uint64_t ddsDomain = 74;
    std::string ddsConfig;                    ///< a file
    std::string ddsSecurity;                  ///< a folder
    std::string durability = "sync";          ///< or "os"
    std::optional<std::uint64_t> minFreeMib;  ///< else the store's own choice
    std::uint64_t keepUnusedBlobsMinutes = 15;
    std::optional<std::uint64_t> historyDays;  ///< else the whole history is kept
    std::uint64_t maxFrameMib = 64;
    std::uint64_t maxBlobMib = 4096;
    std::uint64_t maxTransactionMib = kMaxTransactionBytes >> 20;
    std::uint64_t maxSessions = 1000;
    std::uint64_t slowReaderMib = 16;
    std::uint64_t flushIntervalMs = 0;
    std::vector<std::string> administrators;
    std::uint64_t lockTakeoverMinutes = 15;
    std::string logLevel = "info";
    LogFormat logFormat = LogFormat::Text;
};

/// The options, or the exit code after help was printed (0) or one line that says what is wrong
/// (2).
[[nodiscard]] std::variant<ServerOptions, int> parseOptions(int argc, const char* const* argv);

}  // namespace usdlive::server
