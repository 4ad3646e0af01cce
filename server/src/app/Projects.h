// The projects of this process, and their live sessions.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "app/Options.h"
#include "app/ServedProject.h"
#include "transport/Log.h"

namespace usdlive::server {

/// The projects of this process and their live sessions, by name (ProjectPlace::name()). Belongs to
/// the thread that runs `io`.
class Projects {
public:
    using MakeLog = std::function<std::unique_ptr<Log>(const std::string& project)>;

    /// `options`, `workers`, `audit` and `log` must outlive this object. `makeLog` returns the log
    /// for one project.
    Projects(boost::asio::io_context& io, const ServerOptions& options, Workers& workers,
             AuditLog& audit, MakeLog makeLog, Log& log);
    ~Projects();

    /// Starts to open the projects of the options. Error: InvalidConfiguration names the wrong
    /// option. `opened` is called once, when each project is served or has failed.
    Result<void> open(std::function<void()> opened);
    /// Sets the URL of the process, which starts DDS for the projects and the search for new
    /// folders. `announced` gets the first error.
    void announce(const std::string& url, std::function<void(Result<void>)> announced);
    /// Stops all projects, then calls `done`.
    void stop(std::function<void()> done);

    /// Returns the projects and their live sessions in the order of their names.
    [[nodiscard]] std::vector<ServedProject*> all() const;
    /// Returns the projects without live sessions.
    [[nodiscard]] std::vector<ServedProject*> mainLines() const;
    /// Returns nullptr if there is none of this name.
    [[nodiscard]] ServedProject* find(const std::string& name) const;

    /// Starts to serve a live session of a project. `opened` is called once, when it is served or
    /// has failed.
    void openLiveSession(const ServedProject& project, const std::string& liveSession,
                         std::function<void(Result<void>)> opened);
    /// Stops a live session: its sessions end, and its store is closed. Then calls `closed`; at
    /// once if it is not served.
    void closeLiveSession(const std::string& name, std::function<void()> closed);

    /// Returns true if the process serves several projects or may do so later.
    [[nodiscard]] bool areSeveral() const;
    [[nodiscard]] std::string urlOf(const std::string& base, const ServedProject& project) const;

private:
    /// Adds a project with its live sessions.
    void addProject(const std::string& name, const std::filesystem::path& folder);
    void add(const ProjectPlace& place);
    /// Starts a project or live session that was added while the process serves.
    void startLate(const std::string& name);
    void stopProject(const std::string& project);
    /// Starts the projects that have no thread.
    void startIn(std::chrono::milliseconds pause);
    void changed(const std::string& name);
    void checkOpened();
    void lookForFoldersIn(std::chrono::milliseconds pause);
    void foldersFound(const std::map<std::string, std::filesystem::path>& found);

    struct Entry {
        std::unique_ptr<ServedProject> project;
        unsigned missing = 0;  ///< how often in a row its folder was missing
        bool isNamed = false;  ///< given on the command line, so it is never removed
        /// Serving or Failed, as it was last logged, or read by whoever waited for open().
        std::optional<ServedProject::State> reported;
        std::function<void(Result<void>)> opened = {};  ///< see openLiveSession()
        std::function<void()> closed = {};              ///< see closeLiveSession()
    };

    boost::asio::io_context& io_;
    const ServerOptions& options_;
    Workers& workers_;
    AuditLog& audit_;
    const MakeLog makeLog_;
    Log& log_;
    std::map<std::string, Entry> projects_;
    boost::asio::steady_timer folderTimer_, startTimer_;
    std::function<void()> opened_, stopped_;
    std::string url_;  // the process's address; empty before announce()
};

}  // namespace usdlive::server
