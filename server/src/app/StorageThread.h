// The thread that appends commits to the store.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "app/SharedStore.h"
#include "transport/Log.h"

namespace usdlive::server {

/// Appends commits on a thread of its own. All commits that arrive during an append form the next
/// group, so that one sync and one message to each client serve many commits (group commit). A
/// group starts at least `interval` after the one before: a single user never waits, and many users
/// cost little more than one.
///
/// After a failed append, drops that group and all following commits until resume(): by then the
/// project knows the state of the store and continues from it.
class StorageThread {
public:
    /// Called on the storage thread.
    struct Events {
        std::function<void(Revision upTo)> appended;
        std::function<void(Error error, CommitStore::Head head)> failed;
        /// Called before `failed` if the store is closed and has to be opened again.
        std::function<void()> closed;
        std::function<void(std::size_t commits, std::chrono::nanoseconds time)> measured;
    };

    StorageThread(SharedStore& store, std::chrono::milliseconds interval, Log& log)
        : store_(store), interval_(interval), log_(log) {}
    ~StorageThread() { stop(); }
    /// Throws ThreadRefused.
    void start(Events events);
    /// Appends the waiting commits, then stops.
    void stop();

    // May be called from any thread.
    void append(CommitRecord commit);
    /// Accepts commits again. Returns false if none were dropped since the last call.
    bool resume();
    /// Calls `done` on the storage thread when all commits so far are stored or dropped. `done`
    /// must not call this class.
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
    std::mutex mutex_;  // guards the next four members
    std::condition_variable changed_;
    Work waiting_;
    bool throwingAway_ = false;
    bool stopping_ = false;
    std::chrono::steady_clock::time_point nextGroup_;  // used by the storage thread only
    std::thread thread_;
};

}  // namespace usdlive::server
