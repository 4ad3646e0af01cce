// Measures the memory and time of a call.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>

namespace usdlive::bombs {

/// The cost of a call: its peak of memory from `operator new`, and its processor time.
struct Cost {
    std::size_t bytes = 0;
    std::chrono::milliseconds time{};
};
[[nodiscard]] Cost costOf(const std::function<void()>& call);

/// The allowed factor for sanitizers and unoptimised code.
#if defined(__OPTIMIZE__) && !defined(USDLIVE_SANITIZED)
inline constexpr int kSlowness = 1;
#else
inline constexpr int kSlowness = 50;
#endif

}  // namespace usdlive::bombs
