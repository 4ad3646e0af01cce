// The threads of the process for blocking work, and each project's share of them.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "transport/Log.h"

namespace usdlive::server {

class WorkerShare;

/// Threads for one kind of blocking work, which all projects of the process share.
///
/// Threads are started when they are needed, up to a limit, and stay. A free thread takes the next
/// job of the project that runs the fewest jobs, and among equals of the one that was served
/// longest ago. A project runs at most kMostAtOnce jobs, and one that runs a job never takes the
/// last thread. So a project waits for another one only if each thread runs a job of a different
/// project.
class WorkerLane {
public:
    using Job = std::function<void()>;
    static constexpr std::size_t kMostAtOnce = 2;

    struct Options {
        std::string name;
        std::size_t threads = 1;  ///< limit
        int nice = 0;             ///< added to the priority of the threads
    };

    /// Starts the first thread. Throws ThreadRefused. If the system refuses a later one, the lane
    /// works with those that it has. `log` must outlive this object.
    WorkerLane(Options options, Log& log);
    /// Every share must have been stopped.
    ~WorkerLane();
    WorkerLane(const WorkerLane&) = delete;
    WorkerLane& operator=(const WorkerLane&) = delete;

    /// Returns the share of one more project. The lane must outlive it.
    [[nodiscard]] std::shared_ptr<WorkerShare> share();
    [[nodiscard]] std::size_t threads() const;

private:
    friend class WorkerShare;
    using TimePoint = std::chrono::steady_clock::time_point;

    void run();
    void perform(const Job& job) const;
    // The caller holds mutex_.
    [[nodiscard]] bool mayRun(const WorkerShare& share) const;
    [[nodiscard]] WorkerShare* next() const;
    void wakeOrStart();
    void startAnother();

    const Options options_;
    Log& log_;

    mutable std::mutex mutex_;  // guards all members below, and those of the shares
    std::condition_variable changed_;
    std::vector<WorkerShare*> shares_;
    std::size_t limit_;  // number of threads; less than in the options after one was refused
    std::size_t busy_ = 0, waiting_ = 0;  // threads
    std::uint64_t turns_ = 0;
    TimePoint refusedAt_{};
    bool isStopping_ = false;
    std::vector<std::thread> threads_;
};

/// The jobs of one project in a lane. May be used by any thread.
class WorkerShare {
public:
    explicit WorkerShare(WorkerLane& lane);
    ~WorkerShare();
    WorkerShare(const WorkerShare&) = delete;
    WorkerShare& operator=(const WorkerShare&) = delete;

    /// Adds a job. An exception of a job is logged.
    void post(WorkerLane::Job job);
    /// Waits for the running jobs, and drops the others and those that are posted later. Do not
    /// call it in a job.
    void stop();

private:
    friend class WorkerLane;

    WorkerLane& lane_;
    // Guarded by the mutex of the lane.
    std::deque<WorkerLane::Job> jobs_;
    std::size_t running_ = 0;
    std::uint64_t turn_ = 0;  // the lane's count of turns at the last job that was started
    bool isStopped_ = false;
    std::condition_variable ended_;
};

/// Runs jobs in a share one at a time, in the order in which they are posted. May be used by any
/// thread.
class SerialJobs {
public:
    explicit SerialJobs(std::shared_ptr<WorkerShare> share);
    void post(WorkerLane::Job job);

private:
    struct Queue;
    const std::shared_ptr<Queue> queue_;
};

}  // namespace usdlive::server
