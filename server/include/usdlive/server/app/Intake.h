// Limits the work in progress of sessions.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <set>
#include <vector>

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
        if ((sessions_[session] += bytes) > kSessionBytes) pause(session);
    }
    void end(SessionId session, std::size_t bytes) {
        const auto entry = sessions_.find(session);
        if (entry == sessions_.end()) return;
        entry->second -= std::min(entry->second, bytes);
        resume(session);
        if (entry->second == 0) sessions_.erase(entry);
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
        sessions_.erase(session);
        paused_.erase(session);
    }

    [[nodiscard]] std::size_t storeBytes() const { return store_; }

private:
    void pause(SessionId session) {
        if (paused_.insert(session).second) setReading_(session, false);
    }
    void resume(SessionId session) {
        const auto entry = sessions_.find(session);
        if (entry != sessions_.end() && entry->second > kSessionBytes / 2) return;
        if (store_ <= kStoreBytes && paused_.erase(session)) setReading_(session, true);
    }

    const std::function<void(SessionId, bool)> setReading_;
    std::map<SessionId, std::size_t> sessions_;
    std::size_t store_ = 0;
    std::set<SessionId> paused_;
};

}  // namespace usdlive::server
