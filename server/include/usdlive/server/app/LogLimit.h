// Keeps what clients cause from filling the log.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace usdlive::server {

/// Of what repeats, so many lines in a window are logged; the next line after it says how many were
/// left out. Counts by key; a value, one thread.
class LogLimit {
public:
    static constexpr std::uint64_t kLines = 10;
    static constexpr std::int64_t kWindowMs = 10'000;
    static constexpr std::size_t kMostKeys = 1'000;  ///< beyond, those without a window share one

    /// How many lines of this key were left out before this one; nothing: this one is, too.
    [[nodiscard]] std::optional<std::uint64_t> take(const std::string& key, std::int64_t nowMs);

private:
    struct Window {
        std::int64_t beganMs = 0;
        std::uint64_t lines = 0;
    };
    std::map<std::string, Window> windows_;
};

}  // namespace usdlive::server
