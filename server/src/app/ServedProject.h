// One served project with its disk, threads and transports.
#pragma once

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "app/AuditLog.h"
#include "app/LiveSessionFolder.h"
#include "app/Metrics.h"
#include "app/Options.h"
#include "app/ProjectPlace.h"
#include "app/Workers.h"
#include "auth/SignIn.h"
#include "transport/FileRequest.h"
#include "transport/HttpServer.h"
#include "transport/Log.h"
#include "usdlive/common/core/Thread.h"

namespace usdlive::server {

/// One project of this process, or one of its live sessions: its disk, its threads and its
/// transports. It has a thread for its network and one for its storage, and a share of the
/// process's workers. Functions may be called
/// from any thread, unless a comment says otherwise.
class ServedProject {
public:
    enum class State {
        Opening,  ///< opens for the first time
        Serving,
        Failed,    ///< could not be opened or has no thread; tried again after kRetryPause
        Stopping,  ///< sends acknowledgements and closes its store
        Stopped
    };
    struct Status {
        State state = State::Opening;
        std::optional<Error> error = {};  ///< the error of the last attempt
        std::size_t layers = 0;           ///< number at opening
        std::size_t skippedFiles = 0;
    };
    /// The state of a project, as its own thread reports it.
    struct Report {
        std::string status;  ///< "ok", "storageFull", "starting", "opening", "failed", "stopping"
        std::string reason = {};  ///< for "failed"
        Revision revision = 0;
        std::size_t sessions = 0;
        std::set<UserName> users = {};  ///< have the sessions
        /// Set only if they were asked for, and while the project is served.
        std::shared_ptr<const MetricFamilies> metrics = {};
    };
    static constexpr std::chrono::milliseconds kRetryPause{5'000};

    /// `changed` is called after each change of status(), usually on the project's thread.
    /// `workers`, `audit` and `options` must outlive this object.
    ServedProject(ProjectPlace place, const ServerOptions& options, Workers& workers,
                  AuditLog& audit, std::unique_ptr<Log> log, std::function<void()> changed);
    /// Blocks until stop() has finished.
    ~ServedProject();
    ServedProject(const ServedProject&) = delete;
    ServedProject& operator=(const ServedProject&) = delete;

    /// Opens the project on a thread of its own, unless it has one. Call start() and stop() on the
    /// same thread.
    void start();
    /// Returns true if the system refused a thread of the project. The project has none then, and
    /// is Failed until start() is called again.
    [[nodiscard]] bool lacksThreads() const;

    /// Returns the name in addresses: ProjectPlace::name().
    [[nodiscard]] const std::string& name() const { return name_; }
    [[nodiscard]] const ProjectPlace& place() const { return place_; }
    [[nodiscard]] Status status() const;
    /// Returns the filter for texts that clients are sent.
    [[nodiscard]] const PublicText& texts() const { return texts_; }

    /// Sets the URL for editors. From then on the project is also served over DDS if the options
    /// say so, and a second server for the folder names this one in its error. `done` gets the
    /// error of DDS, on any thread.
    void announce(std::string url, std::function<void(Result<void>)> done);

    /// Returns nullptr if the project accepts no sessions now. Valid until stop() is called.
    [[nodiscard]] WebSocketTransport* sessions() const;
    /// Answers a request for a file or the list of files (AS1-AS4), on any thread.
    void answerFile(FileRequest request, HttpAnswer answer);
    /// Gives signed-in users their roles in these accounts, then calls `done`, on any thread.
    void rolesChanged(std::shared_ptr<const Accounts> accounts, std::function<void()> done);
    /// Calls `done` once, on the project's thread or this one. A busy project answers late. To
    /// collect the metrics takes more work than the rest.
    void report(bool hasMetrics, std::function<void(Report)> done);
    /// Makes a live session, which shares everything that was confirmed up to now (LV1). `done`
    /// gets the result on any thread; an error if the project is not served.
    void branch(LiveSessionRecord wanted, std::function<void(Result<LiveSessionRecord>)> done);
    /// Notifies all clients, sends the acknowledgements and closes the store. The status becomes
    /// Stopped.
    void stop();

private:
    class Running;

    void run();
    void serve(std::unique_ptr<Running> running);
    [[nodiscard]] bool waitForRetry();
    void change(Status status);
    void refused(const ThreadRefused& why);
    /// Calls `use(Running&)` on the project's thread. Returns false if the project is not served.
    bool post(std::function<void(Running&)> use);

    const ProjectPlace place_;
    const std::string name_;
    const PublicText texts_;
    const ServerOptions& options_;
    Workers& workers_;
    AuditLog& audit_;
    const std::unique_ptr<Log> log_;
    const std::function<void()> changed_;

    mutable std::mutex mutex_;  // guards the next seven members
    std::condition_variable stop_;
    Status status_;
    bool stopping_ = false;
    bool lacksThreads_ = false;  // thread_ has ended, or ends now
    std::string url_;
    std::function<void(Result<void>)> announced_;
    Running* running_ = nullptr;

    std::thread thread_;
};

}  // namespace usdlive::server
