#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "usdlive/server/app/SharedStore.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// The thread that appends commits. All that has come while it was at work is its next group, so
/// that one sync pays for many (group commit).
///
/// When an append fails, that group and all that follows is thrown away until goOn(): the project
/// has then been told where the store stands and builds on that.
class StorageThread {
public:
    /// Called on this thread.
    struct Events {
        std::function<void(Revision upTo)> appended;
        std::function<void(Error error, CommitStore::Head head)> failed;
        std::function<void(std::size_t commits, std::chrono::nanoseconds time)> measured;
    };

    StorageThread(SharedStore& store, Log& log) : store_(store), log_(log) {}
    ~StorageThread() { stop(); }
    void start(Events events);
    /// What waits is appended first.
    void stop();

    // Any thread.
    void append(CommitRecord commit);
    void goOn();
    /// Calls `done` on this thread, when all commits so far are in the store or thrown away.
    void flush(std::function<void()> done);

private:
    struct Work {
        std::vector<CommitRecord> commits;
        std::vector<std::function<void()>> flushes;
    };

    void run();
    void appendGroup(const std::vector<CommitRecord>& commits);
    void recover(const Error& error);
    [[nodiscard]] bool pause(std::chrono::milliseconds time);

    SharedStore& store_;
    Log& log_;
    Events events_;
    std::mutex mutex_;  // guards the next four
    std::condition_variable changed_;
    Work waiting_;
    bool throwingAway_ = false;
    bool stopping_ = false;
    std::thread thread_;
};

}  // namespace usdlive::server
