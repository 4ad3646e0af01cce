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

#include "usdlive/server/app/Metrics.h"
#include "usdlive/server/app/Options.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// One project of this process: its disk, its threads and its transports. Projects share no thread
/// and no queue, so what one of them does delays no other. Functions may be called from any thread,
/// except where they say otherwise.
class ServedProject {
public:
    enum class State {
        Opening,  ///< for the first time
        Serving,
        Failed,    ///< cannot be opened; tried again every kRetryPause
        Stopping,  ///< sends what is acknowledged and closes its store
        Stopped
    };
    struct Status {
        State state = State::Opening;
        std::optional<Error> error = {};  ///< why it failed last
        std::size_t layers = 0;           ///< when it was opened
        std::size_t skippedFiles = 0;
    };
    /// What the project's own thread says of it.
    struct Report {
        std::string status;  ///< "ok", "storageFull", "starting", "opening", "failed", "stopping"
        std::string reason = {};  ///< of "failed"
        Revision revision = 0;
        std::size_t sessions = 0;
        std::shared_ptr<const MetricFamilies> metrics = {};  ///< nullptr unless it is served
    };
    static constexpr std::chrono::milliseconds kRetryPause{5'000};

    /// Opens the project on a thread of its own. `changed` is called there after each change of
    /// status(). `log` and `options` have to outlive the project.
    ServedProject(std::string name, std::filesystem::path folder, const ServerOptions& options,
                  std::unique_ptr<Log> log, std::function<void()> changed);
    /// Waits for stop() to be done.
    ~ServedProject();
    ServedProject(const ServedProject&) = delete;
    ServedProject& operator=(const ServedProject&) = delete;

    [[nodiscard]] const std::string& name() const { return name_; }
    [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
    [[nodiscard]] Status status() const;

    /// Says under which URL editors reach it. From then on it is served over DDS, too, if the
    /// options say so, and people who start a second server for the folder are told of this one.
    /// `done` gets the error of DDS; any thread.
    void announce(std::string url, std::function<void(Result<void>)> done);

    /// nullptr: it takes no sessions now. Valid until stop() is called.
    [[nodiscard]] WebSocketTransport* sessions() const;
    /// Calls `done` once, on the project's thread or this one. A project that is very busy answers
    /// late.
    void report(std::function<void(Report)> done);
    /// Tells all clients, sends what is acknowledged and closes the store. The status becomes
    /// Stopped.
    void stop();

private:
    class Running;

    void run();
    void serve(std::unique_ptr<Running> running);
    [[nodiscard]] bool waitForRetry();
    void change(Status status);
    /// Calls `use(Running&)` on the project's thread; false if it is not served.
    bool post(std::function<void(Running&)> use);

    const std::string name_;
    const std::filesystem::path folder_;
    const ServerOptions& options_;
    const std::unique_ptr<Log> log_;
    const std::function<void()> changed_;

    mutable std::mutex mutex_;  // guards the next six
    std::condition_variable stop_;
    Status status_;
    bool stopping_ = false;
    std::string url_;
    std::function<void(Result<void>)> announced_;
    Running* running_ = nullptr;

    std::thread thread_;
};

}  // namespace usdlive::server
