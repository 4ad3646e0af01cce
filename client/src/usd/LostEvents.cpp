// Which events of lost work are told at once, and which stand for several.
#include "usd/LostEvents.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "usd/LostWorkStore.h"

namespace usdlive::client {

namespace {

// Work of more edits is no repetition that a person could take for one.
constexpr std::size_t kMostEdits = 1'000;

// What was to be changed, without the values.
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
    const auto [found, isNew] = told_.try_emplace(registersOf(lost.work));
    Told& told = found->second;
    if (isNew) {
        told.atMs = nowMs;
        if (told_.size() == 1) nextMs_ = nowMs + kTogetherMs;
        return lost;
    }
    if (told.waiting) lost.count += told.waiting->count;
    told.waiting = std::move(lost);
    return std::nullopt;
}

std::vector<event::Lost> LostEvents::due(std::int64_t nowMs) {
    std::vector<event::Lost> events;
    if (told_.empty() || nowMs < nextMs_) return events;
    nextMs_ = std::numeric_limits<std::int64_t>::max();
    for (auto one = told_.begin(); one != told_.end();) {
        Told& told = one->second;
        if (nowMs >= told.atMs + kTogetherMs) {
            if (!told.waiting) {
                one = told_.erase(one);
                continue;
            }
            events.push_back(std::move(*std::exchange(told.waiting, std::nullopt)));
            told.atMs = nowMs;
        }
        nextMs_ = std::min(nextMs_, told.atMs + kTogetherMs);
        ++one;
    }
    std::ranges::sort(events, {}, [](const event::Lost& lost) { return lost.index; });
    return events;
}

std::vector<event::Lost> LostEvents::waiting() {
    std::vector<event::Lost> events;
    for (auto& [key, told] : told_)
        if (told.waiting) events.push_back(std::move(*std::exchange(told.waiting, std::nullopt)));
    std::ranges::sort(events, {}, [](const event::Lost& lost) { return lost.index; });
    return events;
}

}  // namespace usdlive::client
