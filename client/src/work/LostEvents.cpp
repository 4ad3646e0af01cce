// Decides which events about lost edits are reported at once, and merges the others.
#include "work/LostEvents.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "work/LostWorkStore.h"

namespace usdlive::client {

namespace {

// Larger transactions are never merged: a user cannot take them for a repetition.
constexpr std::size_t kMostEdits = 1'000;

// Returns a key of the error code and the edited registers, without their values.
std::string registersOf(const LostWork& work) {
    std::string key(errorName(work.reason.code));
    if (work.edits.empty()) return key + work.reason.message;
    std::vector<AuthoredEdit> edits = work.edits;
    for (AuthoredEdit& edit : edits)
        if (auto* set = std::get_if<SetField>(&edit.action)) set->value = {};
    const Bytes bytes = encodeAuthored(0, edits);
    return key.append(bytes.begin(), bytes.end());
}

}  // namespace

std::optional<event::Lost> LostEvents::add(event::Lost lost, std::int64_t nowMs) {
    if (lost.work.edits.size() > kMostEdits) return lost;
    const auto [found, isNew] = reported_.try_emplace(registersOf(lost.work));
    Reported& reported = found->second;
    if (isNew) {
        reported.atMs = nowMs;
        if (reported_.size() == 1) nextMs_ = nowMs + kTogetherMs;
        return lost;
    }
    if (reported.waiting) lost.count += reported.waiting->count;
    reported.waiting = std::move(lost);
    return std::nullopt;
}

std::vector<event::Lost> LostEvents::due(std::int64_t nowMs) {
    std::vector<event::Lost> events;
    if (reported_.empty() || nowMs < nextMs_) return events;
    nextMs_ = std::numeric_limits<std::int64_t>::max();
    for (auto one = reported_.begin(); one != reported_.end();) {
        Reported& reported = one->second;
        if (nowMs >= reported.atMs + kTogetherMs) {
            if (!reported.waiting) {
                one = reported_.erase(one);
                continue;
            }
            events.push_back(std::move(*std::exchange(reported.waiting, std::nullopt)));
            reported.atMs = nowMs;
        }
        nextMs_ = std::min(nextMs_, reported.atMs + kTogetherMs);
        ++one;
    }
    std::ranges::sort(events, {}, [](const event::Lost& lost) { return lost.index; });
    return events;
}

std::vector<event::Lost> LostEvents::waiting() {
    std::vector<event::Lost> events;
    for (auto& [key, reported] : reported_)
        if (reported.waiting)
            events.push_back(std::move(*std::exchange(reported.waiting, std::nullopt)));
    std::ranges::sort(events, {}, [](const event::Lost& lost) { return lost.index; });
    return events;
}

}  // namespace usdlive::client
