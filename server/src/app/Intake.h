// Limits the work in progress of sessions.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <set>
#include <vector>

#include "project/Project.h"
#include "usdlive/common/core/Budget.h"

namespace usdlive::server {

/// Measures the work in progress: jobs of each session (big values that wait for the disk), and
/// commits that wait for the store. A session whose jobs exceed its share is held until half of
/// them are done. Belongs to the network thread.
class Intake {
public:
    static constexpr std::size_t kSessionBytes = 8 * 1024 * 1024;
    /// The size that a job counts in addition to its data.
    static constexpr std::size_t kJobBytes = 64 * 1024;

    struct Calls {
        std::function<void(SessionId, bool held)> setHeld;
        /// A job of the session has taken this time of a worker.
        std::function<void(SessionId, std::chrono::nanoseconds)> worked;
    };
    explicit Intake(Calls calls) : calls_(std::move(calls)) {}

    void begin(SessionId session, std::size_t bytes) {
        jobs_.take(session, bytes);
        if (jobs_.isOver(session) && held_.insert(session).second) calls_.setHeld(session, true);
    }
    void end(SessionId session, std::size_t bytes, std::chrono::nanoseconds time) {
        if (session != 0) calls_.worked(session, time);
        jobs_.giveBack(session, bytes);
        if (jobs_.of(session) <= kSessionBytes / 2 && held_.erase(session))
            calls_.setHeld(session, false);
    }
    void beginStore(std::size_t bytes) { store_ += bytes; }
    void endStore(std::size_t bytes) { store_ -= std::min(store_, bytes); }
    void closed(SessionId session) {
        jobs_.giveBackAll(session);
        held_.erase(session);
    }

    [[nodiscard]] std::size_t storeBytes() const { return store_; }

private:
    const Calls calls_;
    Budget<SessionId> jobs_{{.each = kSessionBytes}};
    std::size_t store_ = 0;
    std::set<SessionId> held_;
};

}  // namespace usdlive::server
