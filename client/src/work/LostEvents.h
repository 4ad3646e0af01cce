// Limits the rate of events about lost edits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "session/Session.h"

namespace usdlive::client {

/// Limits the rate of events about lost edits. A tool that writes one register of a locked layer
/// sixty times a second is refused sixty times, but its user is notified once a second.
/// LostWorkStore keeps all lost edits; only the events are merged.
class LostEvents {
public:
    static constexpr std::int64_t kTogetherMs = 1'000;

    /// Returns the event if it is to be reported now. Returns nothing if an event with the same
    /// error code and registers was reported within the last kTogetherMs: due() returns the newest
    /// of them later.
    [[nodiscard]] std::optional<event::Lost> add(event::Lost lost, std::int64_t nowMs);
    /// Returns the events that have waited for kTogetherMs, sorted by index. Called in each tick:
    /// allocates nothing if nothing is due.
    [[nodiscard]] std::vector<event::Lost> due(std::int64_t nowMs);
    /// Returns all waiting events, sorted by index, for an editor that disconnects.
    [[nodiscard]] std::vector<event::Lost> waiting();

private:
    struct Reported {
        std::int64_t atMs = 0;
        std::optional<event::Lost> waiting;
    };
    std::unordered_map<std::string, Reported> reported_;  // by error code and registers
    std::int64_t nextMs_ = 0;                             // nothing is due before
};

}  // namespace usdlive::client
