// A thread that executes tasks in order.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace usdlive::client {

/// A thread that executes tasks in order.
class Worker {
public:
    Worker();
    /// Waits for the running task. Drops the tasks that have not begun.
    ~Worker();
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;

    /// Adds a task, which must not throw. May be called by any thread.
    void post(std::function<void()> task);

private:
    void run();

    std::mutex mutex_;  // guards all members below
    std::condition_variable changed_;
    std::deque<std::function<void()>> tasks_;
    bool stopping_ = false;

    std::thread thread_;
};

}  // namespace usdlive::client
