// Decides whether the peer of a connection is still there.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "usdlive/common/transport/SendProgress.h"

namespace usdlive {

/// SE7: a peer that is silent for half of a time is sent a ping, and is lost after all of it. Bytes
/// that move are life: received ones, and, while the ping is on its way behind other data, sent
/// ones that the peer's system takes. Once the ping has arrived, only an answer counts, because the
/// system of a stopped process goes on taking bytes. No I/O; one thread.
class PeerLife {
public:
    using TimePoint = std::chrono::steady_clock::time_point;

    PeerLife(std::chrono::milliseconds longest, TimePoint now)
        : longest_(longest), lastSign_(now) {}

    /// Call when anything was received.
    void received(TimePoint now) {
        lastSign_ = now;
        ping_.reset();
    }
    /// Call when the requested ping was handed to the system.
    void pingWritten(const std::optional<SendProgress>& sent) {
        if (ping_ && sent) ping_->position = sent->acknowledged + sent->waiting;
    }

    enum class Verdict { Alive, SendPing, Lost };
    /// Call now and then, for example every 1/20 of the time.
    [[nodiscard]] Verdict check(const std::optional<SendProgress>& sent, TimePoint now);

private:
    /// A ping that is not answered.
    struct Ping {
        std::uint64_t acknowledged = 0;         ///< when it was last looked at
        std::optional<std::uint64_t> position;  ///< its end in the stream; nothing: not written yet
    };

    void leaveTimeToAnswer(TimePoint now);

    std::chrono::milliseconds longest_;
    TimePoint lastSign_;
    std::optional<Ping> ping_;
};

}  // namespace usdlive
