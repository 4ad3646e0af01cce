// Limits the work in progress of sessions.
#pragma once

#include <cstddef>
#include <functional>
#include <set>
#include <vector>

#include "usdlive/common/core/Budget.h"
#include "usdlive/server/project/Project.h"

namespace usdlive::server {

/// Measures the work in progress and pauses reading from sessions: from a session whose jobs exceed
/// its share (big values that wait for the disk), and from every sender while too much waits for
/// the store. The flow control of the socket then slows the client down.
class Intake {
public:
    static constexpr std::size_t kSessionBytes = 8 * 1024 * 1024;
    static constexpr std::size_t kStoreBytes = 64 * 1024 * 1024;
    /// The size that a job counts in addition to its data.
    static constexpr std::size_t kJobBytes = 64 * 1024;

    explicit Intake(std::function<void(SessionId, bool reading)> setReading)
        : setReading_(std::move(setReading)) {}

    void begin(SessionId session, std::size_t bytes) {
        jobs_.take(session, bytes);
        if (jobs_.isOver(session)) pause(session);
    }
    void end(SessionId session, std::size_t bytes) {
        jobs_.giveBack(session, bytes);
        resume(session);
    }
    void beginStore(std::size_t bytes) { store_ += bytes; }
    void endStore(std::size_t bytes) {
        store_ -= std::min(store_, bytes);
        if (store_ > kStoreBytes / 2) return;
        for (const SessionId session : std::vector(paused_.begin(), paused_.end())) resume(session);
    }
    /// Call after each message of a session.
    void received(SessionId session) {
        if (store_ > kStoreBytes) pause(session);
    }
    void closed(SessionId session) {
        jobs_.giveBackAll(session);
        paused_.erase(session);
    }

    [[nodiscard]] std::size_t storeBytes() const { return store_; }

private:
    void pause(SessionId session) {
        if (paused_.insert(session).second) setReading_(session, false);
    }
    void resume(SessionId session) {
        if (jobs_.of(session) > kSessionBytes / 2) return;
        if (store_ <= kStoreBytes && paused_.erase(session)) setReading_(session, true);
    }

    const std::function<void(SessionId, bool)> setReading_;
    Budget<SessionId> jobs_{{.each = kSessionBytes}};
    std::size_t store_ = 0;
    std::set<SessionId> paused_;
};

}  // namespace usdlive::server
