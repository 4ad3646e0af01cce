#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/server/app/Options.h"
#include "usdlive/server/app/ServedProject.h"
#include "usdlive/server/transport/HttpServer.h"

namespace usdlive::server {

/// The projects of this process, by name, and what HTTP answers about them. Belongs to the thread
/// that runs `io`.
class Projects {
public:
    using MakeLog = std::function<std::unique_ptr<Log>(const std::string& project)>;

    /// `options` and `log` have to outlive it. `makeLog` makes the log of one project.
    Projects(boost::asio::io_context& io, const ServerOptions& options, MakeLog makeLog, Log& log);
    ~Projects();

    /// Starts to open the projects that the options name. InvalidConfiguration: what is wrong with
    /// them. `opened` is called once, when each of them is served or has failed.
    Result<void> open(std::function<void()> opened);
    /// Says at which URL the process listens, so that projects are served over DDS as well; and
    /// looks for new folders from now on. `announced` gets the first error.
    void announce(const std::string& url, const HttpServer& http,
                  std::function<void(Result<void>)> announced);
    /// Stops all of them; then `done`.
    void stop(std::function<void()> done);

    /// In the order of their names.
    [[nodiscard]] std::vector<const ServedProject*> all() const;
    /// Does the process serve several projects, or may it come to?
    [[nodiscard]] bool areSeveral() const;
    [[nodiscard]] std::string urlOf(const std::string& base, const ServedProject& project) const;

    /// What is at a path: `/live` and `/NAME/live` take sessions, `/healthz`, `/metrics` and
    /// `/projects` are pages.
    [[nodiscard]] HttpRoute route(std::string_view path);

private:
    using Reports = std::vector<std::pair<std::string, ServedProject::Report>>;

    void add(const std::string& name, const std::filesystem::path& folder);
    void changed(const std::string& name);
    void checkOpened();
    void lookForFoldersIn(std::chrono::milliseconds pause);
    void foldersFound(const std::map<std::string, std::filesystem::path>& found);

    [[nodiscard]] HttpRoute sessionsOf(ServedProject& project);
    [[nodiscard]] HttpReply notHere(const std::string& what) const;
    void gather(std::function<void(const Reports&)> done);
    [[nodiscard]] HttpReply health(const Reports& reports) const;
    [[nodiscard]] HttpReply list(const Reports& reports) const;
    [[nodiscard]] HttpReply metrics(const Reports& reports) const;

    struct Entry {
        std::unique_ptr<ServedProject> project;
        unsigned missing = 0;   ///< how often in a row its folder was not found
        bool isNamed = false;   ///< by the command line, so that it stays
        bool isLogged = false;  ///< its failure
    };

    boost::asio::io_context& io_;
    const ServerOptions& options_;
    const MakeLog makeLog_;
    Log& log_;
    std::map<std::string, Entry> projects_;
    boost::asio::steady_timer folderTimer_;
    std::function<void()> opened_, stopped_;
    std::string url_;  // of the process; empty before announce()
    const HttpServer* http_ = nullptr;
};

}  // namespace usdlive::server
