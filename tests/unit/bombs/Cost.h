#pragma once

#include <chrono>
#include <cstddef>
#include <functional>

namespace usdlive::bombs {

/// What a call took: the most memory it had from `operator new` at once, and processor time.
struct Cost {
    std::size_t bytes = 0;
    std::chrono::milliseconds time{};
};
[[nodiscard]] Cost costOf(const std::function<void()>& call);

/// How much longer sanitizers and unoptimised code may take.
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
inline constexpr int kSlowness = 1;
#else
inline constexpr int kSlowness = 50;
#endif

}  // namespace usdlive::bombs
