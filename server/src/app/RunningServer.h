// Records which process serves a folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace usdlive::server {

/// Records in the served folder which process serves it, for the error message of a second server.
/// The file `DIR/.usdlive/server.json` exists while the server runs; the file of a killed server is
/// ignored.
class RunningServer {
public:
    /// Writes the file. Ignores a failure, because the file only improves an error message.
    RunningServer(std::filesystem::path folder, const std::string& url);
    ~RunningServer();
    RunningServer(const RunningServer&) = delete;
    RunningServer& operator=(const RunningServer&) = delete;

    struct Where {
        std::int64_t process = 0;
        std::string url;
    };
    /// Returns the server of this folder if its process still runs.
    static std::optional<Where> find(const std::filesystem::path& folder);

private:
    std::filesystem::path file_;
};

/// Returns the URLs at which other machines reach a server that listens at `host`. For 0.0.0.0 and
/// :: there is one with the name of this machine and one for each of its addresses, without
/// loopback if there is another.
[[nodiscard]] std::vector<std::string> reachableUrls(const std::string& host, std::uint16_t port,
                                                     bool isEncrypted);

/// Returns the addresses of this machine, without loopback.
[[nodiscard]] std::vector<std::string> ipv4Addresses();

}  // namespace usdlive::server
