// The projects that a client library of this process has live.
#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "Remote.h"
#include "Url.h"

namespace usdlive::resolver {

/// A project whose layers are live in this process.
struct LiveProject {
    std::string server;  ///< in its addresses
    std::string host;    ///< that answers now
    std::uint16_t port = 0;
    std::string prefix;            ///< begins all paths: the project's name and a slash, or empty
    std::filesystem::path folder;  ///< has a file without content for each live layer
    bool isConnected = true;       ///< the server can be asked

    /// Returns the placeholder of a layer; nothing if there is none.
    [[nodiscard]] std::optional<std::filesystem::path> layerFile(const Url& url) const;
    /// Returns where the placeholder of a layer is, or would be; nothing for paths that are no
    /// layers of this project.
    [[nodiscard]] std::optional<std::filesystem::path> placeOf(const Url& url) const;
    /// Returns the address with the server that answers now.
    [[nodiscard]] Url atServer(Url url) const;
};

/// All live projects of this process, by the token in their addresses. Any thread.
class LiveProjects {
public:
    static LiveProjects& ofProcess();

    /// Returns the token, a text that lasts as long as the process.
    const char* add(const std::string& server, const std::string& prefix,
                    const std::string& folder);
    void setConnected(const std::string& token, const std::string& server, bool isConnected);
    /// Returns nothing for addresses that are not live here.
    [[nodiscard]] std::optional<LiveProject> find(const Url& url) const;
    [[nodiscard]] std::optional<LiveProject> findToken(const std::string& token) const;

private:
    mutable std::mutex mutex_;  // guards the next member
    std::map<std::string, LiveProject> projects_;
};

/// Returns true for layers that OpenUSD opens as USD.
[[nodiscard]] bool isUsdLayer(const std::string& path);

}  // namespace usdlive::resolver
