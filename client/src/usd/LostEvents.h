#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "session/Session.h"

namespace usdlive::client {

/// Tells of lost work at a rate that an editor can show: a tool that writes one register sixty
/// times a second into a locked layer is refused sixty times, and its user reads of it once a
/// second. All lost work itself is kept by LostWorkStore; only its events are collapsed.
class LostEvents {
public:
    static constexpr std::int64_t kTogetherMs = 1'000;

    /// The event to tell now. Nothing when work of the same code and registers was told within the
    /// last kTogetherMs: due() gives it later, the newest for all of them.
    [[nodiscard]] std::optional<event::Lost> add(event::Lost lost, std::int64_t nowMs);
    /// What has waited for kTogetherMs, by index. Called in each tick: allocates nothing when
    /// nothing is due.
    [[nodiscard]] std::vector<event::Lost> due(std::int64_t nowMs);
    /// What still waits, by index: for an editor that leaves.
    [[nodiscard]] std::vector<event::Lost> waiting();

private:
    struct Told {
        std::int64_t atMs = 0;
        std::optional<event::Lost> waiting;
    };
    std::unordered_map<std::string, Told> told_;  // by code and registers
    std::int64_t nextMs_ = 0;                     // nothing is due before
};

}  // namespace usdlive::client
