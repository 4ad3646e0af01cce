// Shares threads among projects.
#include "app/WorkerLane.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "files/OpenUsdThreads.h"
#include "usdlive/common/core/Thread.h"

namespace usdlive::server {

namespace {

using std::chrono::steady_clock;

// The pause after the system refused a thread.
constexpr std::chrono::seconds kRefusedPause{1};

}  // namespace

// ---- WorkerLane

WorkerLane::WorkerLane(Options options, Log& log)
    : options_(std::move(options)), log_(log), limit_(options_.threads) {
    threads_.push_back(startThread(options_.name, [this] { run(); }));
}

WorkerLane::~WorkerLane() {
    {
        const std::lock_guard lock(mutex_);
        isStopping_ = true;
    }
    changed_.notify_all();
    for (std::thread& thread : threads_) thread.join();
}

std::shared_ptr<WorkerShare> WorkerLane::share() { return std::make_shared<WorkerShare>(*this); }

std::size_t WorkerLane::threads() const {
    const std::lock_guard lock(mutex_);
    return threads_.size();
}

void WorkerLane::run() {
    if (options_.nice != 0) ::setpriority(PRIO_PROCESS, id_t(::gettid()), options_.nice);
    std::unique_lock lock(mutex_);
    for (;;) {
        WorkerShare* const share = next();
        if (!share) {
            if (isStopping_) return;
            ++waiting_;
            changed_.wait(lock);
            --waiting_;
            continue;
        }
        Job job = std::move(share->jobs_.front());
        share->jobs_.pop_front();
        ++share->running_;
        share->turn_ = ++turns_;
        ++busy_;
        wakeOrStart();  // for the jobs that are left
        lock.unlock();
        perform(job);
        job = nullptr;  // may refer to objects of the project
        lock.lock();
        --busy_;
        if (--share->running_ == 0) share->ended_.notify_all();
    }
}

void WorkerLane::perform(const Job& job) const try {
    withoutThreadsOfOpenUsd(job);
} catch (const std::exception& fault) {
    log_.write(LogLevel::Error, "a job of a worker failed",
               {{"worker", options_.name}, {"error", fault.what()}});
}

bool WorkerLane::mayRun(const WorkerShare& share) const {
    if (share.jobs_.empty()) return false;
    return share.running_ == 0 || (share.running_ < kMostAtOnce && limit_ - busy_ > 1);
}

/// Returns the share whose job a free thread runs next; nullptr if there is none.
WorkerShare* WorkerLane::next() const {
    WorkerShare* best = nullptr;
    for (WorkerShare* share : shares_)
        if (mayRun(*share) && (!best || std::pair(share->running_, share->turn_) <
                                            std::pair(best->running_, best->turn_)))
            best = share;
    return best;
}

/// Lets another thread run the next job, if one may be run.
void WorkerLane::wakeOrStart() {
    if (!next()) return;
    if (waiting_ > 0)
        changed_.notify_one();
    else if (threads_.size() < options_.threads)
        startAnother();
}

void WorkerLane::startAnother() {
    const auto now = steady_clock::now();
    if (limit_ < options_.threads && now < refusedAt_ + kRefusedPause) return;
    try {
        threads_.push_back(startThread(options_.name, [this] { run(); }));
        limit_ = options_.threads;
    } catch (const ThreadRefused& refused) {
        if (limit_ == options_.threads)
            log_.write(LogLevel::Warning, "fewer workers than configured",
                       {{"worker", options_.name},
                        {"threads", threads_.size()},
                        {"error", refused.what()}});
        limit_ = threads_.size();
        refusedAt_ = now;
    }
}

// ---- WorkerShare

WorkerShare::WorkerShare(WorkerLane& lane) : lane_(lane) {
    const std::lock_guard lock(lane_.mutex_);
    lane_.shares_.push_back(this);
}

WorkerShare::~WorkerShare() {
    stop();
    const std::lock_guard lock(lane_.mutex_);
    std::erase(lane_.shares_, this);
}

void WorkerShare::post(WorkerLane::Job job) {
    const std::lock_guard lock(lane_.mutex_);
    if (isStopped_) return;
    jobs_.push_back(std::move(job));
    lane_.wakeOrStart();
}

void WorkerShare::stop() {
    std::deque<WorkerLane::Job> dropped;  // destroyed without the lock
    {
        const std::lock_guard lock(lane_.mutex_);
        isStopped_ = true;
        dropped.swap(jobs_);
    }
    dropped.clear();
    std::unique_lock lock(lane_.mutex_);
    ended_.wait(lock, [this] { return running_ == 0; });
}

// ---- SerialJobs

struct SerialJobs::Queue : std::enable_shared_from_this<Queue> {
    explicit Queue(std::shared_ptr<WorkerShare> share) : share(std::move(share)) {}

    void add(WorkerLane::Job job) {
        {
            const std::lock_guard lock(mutex);
            jobs.push_back(std::move(job));
            if (std::exchange(isRunning, true)) return;
        }
        postNext();
    }
    void postNext() {
        share->post([queue = shared_from_this()] { queue->runNext(); });
    }
    void runNext() {
        // Also after an exception.
        const std::shared_ptr<void> after(nullptr, [this](void*) { goOn(); });
        WorkerLane::Job job;
        {
            const std::lock_guard lock(mutex);
            job = std::move(jobs.front());
            jobs.pop_front();
        }
        job();
    }
    /// Other jobs of the share get their turn before the next one.
    void goOn() {
        {
            const std::lock_guard lock(mutex);
            isRunning = !jobs.empty();
            if (!isRunning) return;
        }
        postNext();
    }

    const std::shared_ptr<WorkerShare> share;
    std::mutex mutex;  // guards the next members
    std::deque<WorkerLane::Job> jobs;
    bool isRunning = false;
};

SerialJobs::SerialJobs(std::shared_ptr<WorkerShare> share)
    : queue_(std::make_shared<Queue>(std::move(share))) {}

void SerialJobs::post(WorkerLane::Job job) { queue_->add(std::move(job)); }

}  // namespace usdlive::server
