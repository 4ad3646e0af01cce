// Counts log lines by key.
#include "app/LogLimit.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>

namespace usdlive::server {

std::int64_t LogLimit::nowMs() {
    return std::chrono::duration_cast<std::chrono::milliseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

std::optional<std::uint64_t> LogLimit::take(const std::string& key, std::int64_t nowMs) {
    const auto isOver = [&](const Window& window) {
        return std::abs(nowMs - window.beganMs) >= kWindowMs;
    };
    // Expired windows that left nothing out need not be kept.
    if (windows_.size() >= kMostKeys && !windows_.contains(key))
        std::erase_if(windows_, [&](const auto& entry) {
            return isOver(entry.second) && entry.second.lines <= kLines;
        });
    const bool full = windows_.size() >= kMostKeys && !windows_.contains(key);
    const auto [entry, made] = windows_.try_emplace(full ? std::string() : key);
    Window& window = entry->second;
    std::uint64_t leftOut = 0;
    if (made || isOver(window)) {
        leftOut = window.lines > kLines ? window.lines - kLines : 0;
        window = {nowMs, 0};
    }
    if (++window.lines > kLines) return std::nullopt;
    return leftOut;
}

}  // namespace usdlive::server
