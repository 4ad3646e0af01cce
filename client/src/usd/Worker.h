#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace usdlive::client {

/// A thread that does what it is given, in order.
class Worker {
public:
    Worker();
    /// Waits for the task at work; those not begun are dropped.
    ~Worker();
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;

    /// Any thread. A task must not throw.
    void post(std::function<void()> task);

private:
    void run();

    std::mutex mutex_;  // guards all below
    std::condition_variable changed_;
    std::deque<std::function<void()>> tasks_;
    bool stopping_ = false;

    std::thread thread_;
};

}  // namespace usdlive::client
