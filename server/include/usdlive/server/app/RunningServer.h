#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace usdlive::server {

/// Says in the served folder which process serves it, for people who start a second one. The file
/// `DIR/.usdlive/server.json` is there while the server runs; what a killed server left is ignored.
class RunningServer {
public:
    /// Writes the file. A failure is ignored: the file only helps to explain.
    RunningServer(std::filesystem::path folder, const std::string& url);
    ~RunningServer();
    RunningServer(const RunningServer&) = delete;
    RunningServer& operator=(const RunningServer&) = delete;

    struct Where {
        std::int64_t process = 0;
        std::string url;
    };
    /// The server of this folder, if its process still runs.
    static std::optional<Where> find(const std::filesystem::path& folder);

private:
    std::filesystem::path file_;
};

/// The URLs at which others reach a server that listens at `host`: of 0.0.0.0 and :: one for the
/// name of this machine and one for each of its addresses, except loopback if there is another.
[[nodiscard]] std::vector<std::string> reachableUrls(const std::string& host, std::uint16_t port);

}  // namespace usdlive::server
