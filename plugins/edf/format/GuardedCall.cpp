// Calls a provider on a thread of its own, with a time limit.
#include "GuardedCall.h"

#include <pxr/base/tf/errorMark.h>

#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "Problems.h"

namespace usdlive::edf {

namespace {

struct PendingCall {
    std::mutex mutex;
    std::condition_variable changed;
    bool isDone = false, isAbandoned = false;
    std::string reason;
};

std::string reasonOf(const std::function<bool(std::string&)>& call) {
    pxr::TfErrorMark mark;
    std::string why;
    try {
        const bool good = call(why);
        if (good && mark.IsClean()) return {};
        if (!mark.IsClean()) why += (why.empty() ? "" : "; ") + takeProblems(mark);
        return why.empty() ? "it gave no reason" : why;
    } catch (const std::exception& error) {
        mark.Clear();
        return std::string("it threw an exception: ") + error.what();
    } catch (...) {
        mark.Clear();
        return "it threw an exception that is no std::exception";
    }
}

}  // namespace

std::string startDetached(std::function<void()> run) {
    try {
        std::thread(std::move(run)).detach();
        return {};
    } catch (const std::system_error& error) {
        return std::string("no thread could be started: ") + error.what();
    }
}

std::string callGuarded(std::function<bool(std::string&)> call, std::chrono::milliseconds limit,
                        const std::shared_ptr<std::atomic<bool>>& isCancelled,
                        const AbandonedCalls& abandoned) {
    if (*abandoned >= kMaxAbandonedCalls)
        return "it is not called, because " + std::to_string(kMaxAbandonedCalls) +
               " earlier calls have not returned yet";
    auto pending = std::make_shared<PendingCall>();
    const auto problem = startDetached([pending, abandoned, call = std::move(call)]() mutable {
        auto reason = reasonOf(call);
        call = nullptr;  // ends what it owns before the waiting thread goes on
        const std::lock_guard lock(pending->mutex);
        pending->reason = std::move(reason);
        pending->isDone = true;
        if (pending->isAbandoned) --*abandoned;
        pending->changed.notify_one();
    });
    if (!problem.empty()) return problem;
    std::unique_lock lock(pending->mutex);
    if (pending->changed.wait_for(lock, limit, [&] { return pending->isDone; }))
        return pending->reason;
    pending->isAbandoned = true;
    ++*abandoned;
    *isCancelled = true;
    return "it did not answer within " + std::to_string(limit.count()) + " ms";
}

}  // namespace usdlive::edf
