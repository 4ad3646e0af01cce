// The options of the server.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "app/SpdLog.h"
#include "auth/SignIn.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

/// Stands for a certificate that the server makes itself.
inline constexpr const char* kOwnCertificate = "auto";

/// The options of the command line and the configuration file.
struct ServerOptions {
    std::vector<std::filesystem::path> folders;  ///< each is a project
    std::filesystem::path projectsFolder;  ///< each of its subfolders is a project; empty: none
    std::string host = "127.0.0.1";
    std::uint16_t port = 7447;
    std::filesystem::path portFile;
    bool page = false;              ///< starts the gateway of the page beside the server
    std::uint16_t pagePort = 7448;  ///< 0: any
    std::vector<std::string> allowedHosts, allowedOrigins;
    /// The files of a certificate and its key, or kOwnCertificate; empty: not encrypted.
    std::vector<std::string> tls;
    bool insecure = false;                 ///< lets others reach it without sign-in or encryption
    std::optional<IssuerSettings> issuer;  ///< nothing: no OpenID Connect
    bool dds = false;
    std::string ddsInterface = "lo";
    std::uint64_t ddsDomain = 74;
    std::string ddsConfig;                    ///< path of a file
    std::string ddsSecurity;                  ///< path of a folder
    std::string durability = "sync";          ///< or "os"
    std::optional<std::uint64_t> minFreeMib;  ///< not set: the store's default
    bool reloadsFiles = false;
    std::uint64_t keepUnusedBlobsMinutes = 15;
    std::optional<std::uint64_t> historyDays;  ///< not set: the whole history is kept
    std::uint64_t maxFrameMib = 64;
    std::uint64_t maxBlobMib = 4096;
    std::uint64_t maxTransactionMib = kMaxTransactionBytes >> 20;
    std::uint64_t maxSessions = 1000;
    std::uint64_t maxUserSessions = 100;
    std::uint64_t maxUserLayers = 100'000;
    std::uint64_t maxGuests = 1000;
    std::uint64_t guestSeconds = 10;
    std::uint64_t slowReaderMib = 16;
    std::uint64_t flushIntervalMs = 0;
    std::vector<std::string> administrators;
    std::uint64_t lockTakeoverMinutes = 15;
    std::string logLevel = "info";
    LogFormat logFormat = LogFormat::Text;
};

/// Returns the options, or the exit code: 0 after printing the help, 2 after printing one line with
/// the error.
[[nodiscard]] std::variant<ServerOptions, int> parseOptions(int argc, const char* const* argv);

}  // namespace usdlive::server
