// The projects that a client library of this process has live.
#pragma once

#include <atomic>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "Remote.h"
#include "Url.h"

namespace usdlive::resolver {

/// The part of a frame in which nothing may wait for the server. Any thread.
class Tick {
public:
    void begin() { isRunning_ = true; }
    /// Returns the files that were needed since the last time: paths in the project.
    [[nodiscard]] std::set<std::string> end();
    [[nodiscard]] bool isRunning() const { return isRunning_; }

    /// Call it when the file with this content, a hash or a version, has come, and whether the
    /// cache has it.
    void fetched(const std::string& path, const std::string& content, bool isKept);
    /// Returns whether the file has come, and the cache cannot be written.
    [[nodiscard]] bool wasFetched(const std::string& path, const std::string& content) const;
    /// Call it when the cache has the file.
    void found(const std::string& path);
    /// A file that the cache removed again before it was found, several times, is given up: the
    /// cache is too small for what the stage needs.
    void need(const std::string& path);

    /// Call it for a file that cannot be looked for, because there is no list of files yet, and
    /// look for it once more after that.
    void seek(const std::string& path);
    /// Returns these files when there is a list.
    [[nodiscard]] std::set<std::string> takeSought();

private:
    std::atomic<bool> isRunning_ = false;
    mutable std::mutex mutex_;  // guards the next members
    std::set<std::string> needed_, sought_;
    std::map<std::string, std::string> fetched_;  // contents by path
    std::map<std::string, int> times_;            // how often a file was fetched and not found
};

/// The layers of a live project that are read as files, with their content. Any thread.
class FileLayers {
public:
    void set(const std::string& path, bool isFile);
    [[nodiscard]] bool contains(const std::string& path) const;
    [[nodiscard]] bool isEmpty() const;
    /// Call it when OpenUSD opens a layer with this content (Entry::content()).
    void opened(const std::string& path, const std::string& content, double seconds);
    /// Returns the time of the content that was opened last, in seconds.
    [[nodiscard]] std::optional<double> timeOf(const std::string& path) const;
    /// Returns the layers that were opened with another content than they have in this list, once
    /// for each content.
    [[nodiscard]] std::vector<std::string> changedIn(const Snapshot& now);

private:
    struct Opened {
        std::string content;  // empty until it is opened
        double seconds = 0;
    };
    mutable std::mutex mutex_;  // guards the next member
    std::map<std::string, Opened> layers_;
};

/// A project whose layers are live in this process.
struct LiveProject {
    std::string addressHost;  ///< in its addresses
    std::uint16_t addressPort = 0;
    std::string host;  ///< that answers now
    std::uint16_t port = 0;
    std::string prefix;            ///< begins all paths: the project's name and a slash, or empty
    std::filesystem::path folder;  ///< has a file without content for each live layer
    bool isConnected = true;       ///< the server can be asked
    bool isClosed = false;         ///< its client has ended
    std::shared_ptr<Tick> tick = std::make_shared<Tick>();
    std::shared_ptr<FileLayers> fileLayers = std::make_shared<FileLayers>();

    /// Returns whether the address is one of this project's server.
    [[nodiscard]] bool hasServerOf(const Url& url) const {
        return url.port == addressPort && url.host == addressHost;
    }
    /// Returns whether the address is that of a layer that is read as a file.
    [[nodiscard]] bool isFileLayer(const Url& url) const;
    /// Returns the placeholder of a layer; nothing if there is none, or if it is read as a file.
    [[nodiscard]] std::optional<std::filesystem::path> layerFile(const Url& url) const;
    /// Returns where the placeholder of a layer is, or would be; nothing for paths that are no
    /// layers of this project.
    [[nodiscard]] std::optional<std::filesystem::path> placeOf(const Url& url) const;
    /// Returns the path without the prefix. Precondition: the path begins with it.
    [[nodiscard]] std::string inProject(const Url& url) const {
        return url.path.substr(prefix.size());
    }
    /// Returns the address with the server that answers now.
    [[nodiscard]] Url atServer(Url url) const;
};

/// Never changes: a change makes another one. nullptr: none.
using LiveProjectPtr = std::shared_ptr<const LiveProject>;

/// All live projects of this process, by the token in their addresses. Any thread.
class LiveProjects {
public:
    static LiveProjects& ofProcess();

    /// Returns the token, a text that lasts as long as the process.
    const char* add(const std::string& server, const std::string& prefix,
                    const std::string& folder);
    void setConnected(const std::string& token, const std::string& server, bool isConnected);
    void close(const std::string& token);
    /// Returns nothing for addresses that are not live here.
    [[nodiscard]] LiveProjectPtr find(const Url& url) const;
    [[nodiscard]] LiveProjectPtr findToken(const std::string& token) const;
    /// Returns a live project that has the file, whether or not its address is live: if possible
    /// one that is in a tick, or else one that is connected.
    [[nodiscard]] LiveProjectPtr findAt(const Url& url) const;

private:
    /// Replaces a project by a changed copy.
    template <class Change>
    void change(const std::string& token, Change change);

    mutable std::mutex mutex_;  // guards the next member
    std::map<std::string, LiveProjectPtr> projects_;
};

/// Returns true for layers that OpenUSD opens as USD.
[[nodiscard]] bool isUsdLayer(const std::string& path);

}  // namespace usdlive::resolver
