// Appends commits in groups, and reopens the store after a failure.
#include "app/StorageThread.h"

#include <utility>

#include "app/Faults.h"
#include "usdlive/common/core/Thread.h"

namespace usdlive::server {

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kReopenPause{1'000};
// A group with this many bytes does not wait for more.
constexpr std::size_t kFullGroup = 1024 * 1024;

}  // namespace

void StorageThread::start(Events events) {
    events_ = std::move(events);
    thread_ = startThread("storage", [this] { run(); });
}

void StorageThread::stop() {
    {
        const std::lock_guard lock(mutex_);
        stopping_ = true;
    }
    changed_.notify_all();
    if (thread_.joinable()) thread_.join();
}

void StorageThread::append(CommitRecord commit) {
    bool wakes = false;
    {
        const std::lock_guard lock(mutex_);
        if (throwingAway_) return;
        const std::size_t before = waiting_.bytes;
        if (commit.frame) waiting_.bytes += commit.frame->size();
        waiting_.commits.push_back(std::move(commit));
        const bool full = before < kFullGroup && waiting_.bytes >= kFullGroup;
        wakes = waiting_.commits.size() == 1 || full;
    }
    // Notifies after unlocking, so that the woken thread does not wait for the lock.
    if (wakes) changed_.notify_all();
}

bool StorageThread::resume() {
    const std::lock_guard lock(mutex_);
    return std::exchange(throwingAway_, false);
}

void StorageThread::flush(std::function<void()> done) {
    const std::lock_guard lock(mutex_);
    waiting_.flushes.push_back(std::move(done));
    changed_.notify_all();
}

void StorageThread::run() {
    for (;;) {
        const Work work = nextWork();
        if (!work.commits.empty()) appendGroup(work.commits);
        for (const auto& done : work.flushes) done();
        if (work.commits.empty() && work.flushes.empty()) return;
    }
}

/// Returns nothing when the thread has to stop.
StorageThread::Work StorageThread::nextWork() {
    std::unique_lock lock(mutex_);
    const auto urgent = [this] {
        return stopping_ || !waiting_.flushes.empty() || waiting_.bytes >= kFullGroup;
    };
    changed_.wait(lock, [&] { return urgent() || !waiting_.commits.empty(); });
    if (Clock::now() < nextGroup_) changed_.wait_until(lock, nextGroup_, urgent);
    nextGroup_ = Clock::now() + interval_;
    return std::exchange(waiting_, {});
}

void StorageThread::appendGroup(const std::vector<CommitRecord>& commits) {
    faultPoint("append-before");
    const auto begin = Clock::now();
    const auto appended = store_.use([&](CommitStore& store) { return store.append(commits); });
    if (!appended) return recover(appended.error());
    faultPoint("append-after");
    events_.measured(commits.size(), Clock::now() - begin);
    events_.appended(commits.back().revision);
}

void StorageThread::recover(const Error& error) {
    log_.write(LogLevel::Error, "append failed",
               {{"code", errorName(error.code)}, {"error", error.message}});
    {
        const std::lock_guard lock(mutex_);
        throwingAway_ = true;
        waiting_.commits.clear();
        waiting_.bytes = 0;
    }
    // A full disk leaves the store unchanged. After any other error only reopening shows its state,
    // because a failed sync is never retried.
    if (error.code != ErrorCode::StorageFull) {
        events_.closed();
        for (;;) {
            const auto opened = store_.open();
            if (opened) break;
            log_.write(LogLevel::Error, "store cannot be opened again",
                       {{"error", opened.error().message}});
            if (!pause(kReopenPause)) return;
        }
        log_.write(LogLevel::Warning, "store opened again");
    }
    const auto head =
        store_.use([](CommitStore& store) -> Result<CommitStore::Head> { return store.head(); });
    if (head) events_.failed(error, *head);
}

/// Returns false when the thread has to stop.
bool StorageThread::pause(std::chrono::milliseconds time) {
    const auto end = Clock::now() + time;
    std::unique_lock lock(mutex_);
    while (!stopping_ && Clock::now() < end) {
        // All waiting commits have been dropped.
        for (const auto& done : std::exchange(waiting_.flushes, {})) done();
        changed_.wait_until(lock, end, [this] { return stopping_ || !waiting_.flushes.empty(); });
    }
    return !stopping_;
}

}  // namespace usdlive::server
