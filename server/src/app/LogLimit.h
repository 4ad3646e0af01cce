// Prevents clients from filling the log.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace usdlive::server {

/// Limits repeated lines to kLines in a window of time. The next line after it reports how many
/// were left out. Counts by key; a value for one thread.
class LogLimit {
public:
    static constexpr std::uint64_t kLines = 10;
    static constexpr std::int64_t kWindowMs = 10'000;
    static constexpr std::size_t kMostKeys = 1'000;  ///< more keys share one window

    /// Returns the time for take().
    [[nodiscard]] static std::int64_t nowMs();
    /// Returns how many lines of this key were left out before this one, or nothing if this one is
    /// to be left out.
    [[nodiscard]] std::optional<std::uint64_t> take(const std::string& key, std::int64_t nowMs);

private:
    struct Window {
        std::int64_t beganMs = 0;
        std::uint64_t lines = 0;
    };
    std::map<std::string, Window> windows_;
};

}  // namespace usdlive::server
