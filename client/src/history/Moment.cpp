// Moments as people write them.
#include "history/Moment.h"

#include <charconv>
#include <ctime>
#include <string>

namespace usdlive::client {

namespace {

std::int64_t unitMs(char unit) {
    constexpr std::int64_t kSecond = 1'000;
    switch (unit) {
        case 's':
            return kSecond;
        case 'm':
            return 60 * kSecond;
        case 'h':
            return 3'600 * kSecond;
        case 'd':
            return 86'400 * kSecond;
        case 'w':
            return 7 * 86'400 * kSecond;
        default:
            return 0;
    }
}

}  // namespace

Result<std::int64_t> momentOf(std::string_view text) {
    if (!text.empty()) {
        std::uint32_t count = 0;
        const char* const end = text.data() + text.size() - 1;
        const auto [stop, error] = std::from_chars(text.data(), end, count);
        const std::int64_t unit = unitMs(*end);
        if (error == std::errc() && stop == end && unit > 0)
            return std::int64_t(std::time(nullptr)) * 1'000 - count * unit;
    }
    for (const char* form : {"%Y-%m-%d", "%Y-%m-%d %H:%M", "%Y-%m-%dT%H:%M", "%Y-%m-%d %H:%M:%S",
                             "%Y-%m-%dT%H:%M:%S"}) {
        std::tm local{};
        local.tm_isdst = -1;
        const std::string copy(text);
        const char* stop = ::strptime(copy.c_str(), form, &local);
        if (!stop || *stop != '\0') continue;
        const std::time_t seconds = std::mktime(&local);
        if (seconds != -1) return std::int64_t(seconds) * 1'000;
    }
    return fail(ErrorCode::InvalidArgument,
                "'" + std::string(text) +
                    "' is no time: write 30m, 2h or 3d for a time before now, or a date such as "
                    "2026-11-29 or '2026-11-29 14:05'");
}

}  // namespace usdlive::client
