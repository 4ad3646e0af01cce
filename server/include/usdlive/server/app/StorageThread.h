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
/// that one sync, and one message to each client, pays for many (group commit). A group begins no
/// sooner than `interval` after the one before, so that somebody who works alone never waits, and
/// many together cost little more than one.
///
/// When an append fails, that group and all that follows is thrown away until goOn(): the project
/// has then been told where the store stands and builds on that.
class StorageThread {
public:
    /// Called on this thread.
    struct Events {
        std::function<void(Revision upTo)> appended;
        std::function<void(Error error, CommitStore::Head head)> failed;
        /// Before it: the store has failed and is closed until it can be opened again.
        std::function<void()> closed;
        std::function<void(std::size_t commits, std::chrono::nanoseconds time)> measured;
    };

    StorageThread(SharedStore& store, std::chrono::milliseconds interval, Log& log)
        : store_(store), interval_(interval), log_(log) {}
    ~StorageThread() { stop(); }
    void start(Events events);
    /// What waits is appended first.
    void stop();

    // Any thread.
    void append(CommitRecord commit);
    /// False: nothing was thrown away since the last call.
    bool goOn();
    /// Calls `done` on this thread, when all commits so far are in the store or thrown away. It may
    /// not call anything of this class.
    void flush(std::function<void()> done);

private:
    struct Work {
        std::vector<CommitRecord> commits;
        std::size_t bytes = 0;
        std::vector<std::function<void()>> flushes;
    };

    void run();
    [[nodiscard]] Work nextWork();
    void appendGroup(const std::vector<CommitRecord>& commits);
    void recover(const Error& error);
    [[nodiscard]] bool pause(std::chrono::milliseconds time);

    SharedStore& store_;
    const std::chrono::milliseconds interval_;
    Log& log_;
    Events events_;
    std::mutex mutex_;  // guards the next four
    std::condition_variable changed_;
    Work waiting_;
    bool throwingAway_ = false;
    bool stopping_ = false;
    std::chrono::steady_clock::time_point nextGroup_;  // this thread's
    std::thread thread_;
};

}  // namespace usdlive::server
