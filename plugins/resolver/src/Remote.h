// Served projects as this process sees them.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "Url.h"
#include "usdlive/common/fetch/HashCache.h"
#include "usdlive/common/fetch/UsdliveServer.h"

namespace usdlive::resolver {

using fetch::BodySink;
using fetch::failed;
using fetch::Failure;
using fetch::Fetched;
using fetch::HashCache;
using fetch::OpenFile;

/// A file of a project at one moment.
struct Entry {
    std::string version;  ///< names the content of a layer with a history; otherwise empty
    std::string hash;     ///< SHA-256 of the file; empty: the server does not know it yet
    std::int64_t modifiedMs = 0;
    std::optional<std::uint64_t> size = {};  ///< bytes; nothing for a layer with a history

    /// Names the content in resolved paths: a version, as versionToken() makes it, or a hash.
    [[nodiscard]] std::string content() const;
};

/// The files of a project at one revision. A value that never changes.
struct Snapshot {
    std::string project;
    std::uint64_t revision = 0;
    std::string pin;
    std::string etag;
    std::unordered_map<std::string, Entry> files;
};
using SnapshotPtr = std::shared_ptr<const Snapshot>;

/// A project of a server. Any thread.
class RemoteProject {
public:
    RemoteProject(std::string host, std::uint16_t port, std::string name, std::string prefix,
                  fetch::HttpLimits limits, HashCache& cache);

    [[nodiscard]] const std::string& name() const { return name_; }
    /// True if addresses name the project, because the server has several.
    [[nodiscard]] bool hasPrefix() const { return !prefix_.empty(); }

    /// Returns the last snapshot. Asks the server for a new one if the last one was not used for
    /// longer than `idle` (always, if that is negative), or is some seconds old.
    [[nodiscard]] Fetched<SnapshotPtr> newest(std::chrono::milliseconds idle);
    /// Returns the snapshot of a revision or checkpoint.
    [[nodiscard]] Fetched<SnapshotPtr> at(const std::string& pin);
    /// Returns the last snapshot, or the last failure. Asks the server only the first time.
    [[nodiscard]] Fetched<SnapshotPtr> known();
    /// Returns the last snapshot, or nullptr. Asks no server.
    [[nodiscard]] SnapshotPtr last() const;

    // The list without layers, for projects whose layers are live. The server sends it again only
    // if one of these files has changed (AS1).
    /// Asks the server for the list.
    [[nodiscard]] Fetched<SnapshotPtr> follow();
    /// Returns the last list, or the last failure. Asks the server only the first time.
    [[nodiscard]] Fetched<SnapshotPtr> followed();
    /// Returns the last list, or nullptr. Asks no server.
    [[nodiscard]] SnapshotPtr lastFollowed() const;

    /// Opens a layer that has a history, at a version that versionToken() made.
    [[nodiscard]] Fetched<OpenFile> openVersion(const std::string& path, const std::string& token);
    /// Opens the file with this content, which Entry::content() names.
    [[nodiscard]] Fetched<OpenFile> open(const std::string& path, const std::string& content);
    /// Opens a file of which the cache has this content, a hash or a version of versionToken().
    /// Asks no server.
    [[nodiscard]] Fetched<OpenFile> openKept(const std::string& path, const std::string& content);
    /// Returns whether openKept() opens it at once. A large file may have to be hashed first.
    [[nodiscard]] bool isReady(const std::string& path, const std::string& content) const;
    /// Opens the file with this content, or with the present content if the project has another one
    /// by now. `hash` may be empty.
    [[nodiscard]] Fetched<OpenFile> openFile(const std::string& path, const std::string& hash);

private:
    using Clock = std::chrono::steady_clock;
    struct Asked {
        SnapshotPtr snapshot;
        Clock::time_point when;   ///< when it was asked for or used
        Clock::time_point asked;  ///< when it was asked for
        std::optional<Failure> failure;
    };
    /// The query that requests a list, and the pin.
    struct Listing {
        std::string query;
        std::string pin = {};
    };
    [[nodiscard]] static Listing listingOf(const std::string& pin);
    [[nodiscard]] Fetched<SnapshotPtr> ask(Asked& known, const Listing& listing,
                                           std::chrono::milliseconds idle);
    /// Returns what ask() would return without asking again.
    [[nodiscard]] Fetched<SnapshotPtr> lastOf(Asked& known, const Listing& listing);
    [[nodiscard]] Fetched<SnapshotPtr> request(const SnapshotPtr& known, const Listing& listing);
    [[nodiscard]] fetch::HttpRequest requestFor(const std::string& target) const;
    [[nodiscard]] Fetched<std::string> download(const std::string& target,
                                                const std::string& wanted,
                                                std::optional<std::uint64_t> size, BodySink& sink);
    /// Returns the size that the last lists name for this content.
    [[nodiscard]] std::optional<std::uint64_t> sizeOf(const std::string& path,
                                                      const std::string& hash) const;

    const std::string host_;
    const std::uint16_t port_;
    const std::string name_, prefix_, origin_;
    const fetch::HttpLimits limits_;
    const bool takesZstd_;
    HashCache& cache_;

    std::mutex asking_;         // held while the server is asked, so that it is asked once
    mutable std::mutex mutex_;  // guards the next members
    Asked newest_;
    Asked followed_;                       // without layers
    std::map<std::string, Asked> pinned_;  // by pin
};
using ProjectPtr = std::shared_ptr<RemoteProject>;

/// A file of a project.
struct Located {
    ProjectPtr project;
    std::string path;  ///< in the project
};

/// All servers that this process has asked. Any thread.
class Remotes {
public:
    Remotes();
    /// The ones that all parts of the plug-in share.
    static Remotes& ofProcess();

    /// Finds the project of an address. Failure: the host is not allowed, the server does not
    /// answer, or it has no such project.
    [[nodiscard]] Fetched<Located> locate(const Url& url);
    /// Does the same, but does not ask a server again that has not answered. `refresh()` of a
    /// client does.
    [[nodiscard]] Fetched<Located> locateOnce(const Url& url);
    /// Does the same with what is known already. Asks no server.
    [[nodiscard]] Fetched<Located> locateKnown(const Url& url);
    /// Allows a host, because the process has a connection to it.
    void allow(const std::string& host);
    /// Asks for the newest snapshots of all projects that were used without a context. Returns true
    /// if one has changed.
    [[nodiscard]] bool refresh();
    [[nodiscard]] const std::string& user() const { return user_; }

    HashCache cache;

private:
    struct Server {
        std::mutex asking;
        std::mutex mutex;  // guards the other members
        bool isKnown = false;
        bool hasSeveral = false;
        std::map<std::string, ProjectPtr> projects;  // and live sessions that were used
        ProjectPtr only;                             // if the server lists one project
        std::chrono::steady_clock::time_point when;
        std::optional<Failure> failure;
    };
    [[nodiscard]] std::optional<Failure> whyForbidden(const Url& url);
    [[nodiscard]] Server& serverOf(const Url& url);
    [[nodiscard]] std::optional<Located> locateIn(Server& server, const Url& url);
    [[nodiscard]] std::optional<Failure> ask(Server& server, const Url& url, bool again);

    const std::string user_;
    const fetch::HttpLimits limits_;
    std::mutex mutex_;  // guards the next members
    std::vector<std::string> allowedHosts_;
    std::map<std::string, std::unique_ptr<Server>> servers_;
};

/// While it exists, requests of this thread fail soon after `isStopped` returns true.
class StoppableRequests {
public:
    explicit StoppableRequests(std::function<bool()> isStopped);
    ~StoppableRequests();
    StoppableRequests(const StoppableRequests&) = delete;
    StoppableRequests& operator=(const StoppableRequests&) = delete;
};

/// Returns the text for a version in a resolved path: for `12-abc...` the revision and the first
/// digits of the hash.
[[nodiscard]] std::string versionToken(const std::string& version);
/// Returns true for the token of a file without history: its hash.
[[nodiscard]] bool isHashToken(const std::string& token);
/// Returns the revision in a token of a layer with a history.
[[nodiscard]] std::string revisionOf(const std::string& token);

}  // namespace usdlive::resolver
