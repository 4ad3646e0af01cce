// The files of the project that are not live: textures, packages, layers of value clips, and
// others.
#pragma once

#include <pxr/usd/sdf/layer.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "basics/Worker.h"
#include "transport/Connection.h"
#include "usdlive/common/core/ResolverInterface.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Encodes the characters of a path that would be read as something else in an address. The plug-in
/// writes the address as it is written everywhere (ArResolver::CreateIdentifier).
[[nodiscard]] std::string encodedInAddress(std::string_view path);

/// Lets the resolver plug-in find the files of the project, and follows their changes. A worker
/// asks the server for the list of files, for at most a twentieth of its time; no other function
/// waits for the server. Used by the thread that owns the layers.
class PlainFiles {
public:
    PlainFiles();
    /// Stops requests that have not been answered.
    ~PlainFiles();
    PlainFiles(const PlainFiles&) = delete;
    PlainFiles& operator=(const PlainFiles&) = delete;

    /// Returns the address of the project, whose layers have placeholders in `folder`. Nothing if
    /// the plug-in or an address for HTTP is missing; problem() says why.
    [[nodiscard]] std::optional<std::string> start(const std::filesystem::path& folder,
                                                   const std::optional<ServerAddress>& web);
    [[nodiscard]] bool isStarted() const { return token_ != nullptr; }
    [[nodiscard]] const std::optional<Error>& problem() const { return problem_; }

    /// Call it in every tick. Asks for the list of files if that is due.
    void follow(bool isConnected, const Connection& connection, std::int64_t nowMs);
    /// Keeps composition from waiting for the server: as long as it exists, files that stages
    /// compose and that are not here yet are not found. They are fetched when the last one ends.
    class Tick {
    public:
        explicit Tick(PlainFiles& files);
        ~Tick();
        Tick(const Tick&) = delete;
        Tick& operator=(const Tick&) = delete;

    private:
        PlainFiles& files_;
    };
    /// Sets whether a layer is a file like others: it has its content when it is opened, and is
    /// loaded again when it changes. Precondition: isStarted().
    void readAsFile(const std::string& path, bool isFile);
    /// Returns whether openWithContent() may be called: not within a Tick, not without a
    /// connection, and not soon after the server did not answer.
    [[nodiscard]] bool mayWait() const;
    /// Opens a layer of the project that is not live yet with the content that it has at the
    /// server, for which it waits. Returns null if it cannot be fetched or read.
    [[nodiscard]] pxr::SdfLayerRefPtr openWithContent(const std::string& path,
                                                      const std::string& identifier);
    /// Returns the path in the project of the file with this identifier of a layer. Nothing for
    /// layers of other origin.
    [[nodiscard]] std::optional<std::string> fileAt(const std::string& identifier) const;

    /// Requests the list of files as soon as possible. Returns a number for isReported().
    [[nodiscard]] std::uint64_t askSoon();
    /// Returns true when the list that askSoon() has requested is here, or could not be fetched,
    /// and takeChanges() has returned what it changed.
    [[nodiscard]] bool isReported(std::uint64_t list) const;
    /// The files to which something has happened, sorted.
    struct Changes {
        std::vector<std::string> changed;  ///< were added, changed or removed in the project
        std::vector<std::string> arrived;  ///< were needed by a Tick, and are here
        [[nodiscard]] bool isEmpty() const { return changed.empty() && arrived.empty(); }
    };
    /// Returns what has happened since the last call.
    [[nodiscard]] Changes takeChanges();
    /// Loads layers again that were made from these files, except for unsaved and live ones, and
    /// lets stages resolve their asset paths again. Returns the files of which no layer is loaded.
    std::vector<std::string> reload(
        const std::vector<std::string>& files,
        const std::function<bool(const pxr::SdfLayerHandle&)>& isLive) const;

private:
    struct State;
    void ask(std::int64_t nowMs);
    void fetchUsed();
    void fetchNeeded(std::set<std::string> files);
    static void fetchNext(const std::shared_ptr<State>& state, Worker& worker,
                          std::vector<std::string> files);

    const ResolverInterface* resolver_ = nullptr;
    const char* token_ = nullptr;
    std::string base_;
    bool isConnected_ = true;
    int ticks_ = 0;             // number of objects of Tick
    std::uint64_t wanted_ = 0;  // the last number of askSoon()
    std::int64_t dueAtMs_ = 0;
    std::int64_t mayWaitAtMs_ = 0;
    std::int64_t retryAtMs_ = 0, pauseMs_ = 0;  // for files that did not arrive
    std::optional<Error> problem_;
    std::shared_ptr<State> state_;    // shared with the worker's task
    std::unique_ptr<Worker> worker_;  // made by start()
};

}  // namespace usdlive::client
