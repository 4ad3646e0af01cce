// Calls foreign code that may throw, post errors or never return.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>

namespace usdlive::edf {

/// How many calls of one provider are still running although nobody waits for them. Shared by those
/// calls.
using AbandonedCalls = std::shared_ptr<std::atomic<int>>;
constexpr int kMaxAbandonedCalls = 4;

/// Runs a function, which must not throw, on a thread that nobody waits for. Returns the reason if
/// the system refuses one, or an empty text.
[[nodiscard]] std::string startDetached(std::function<void()> run);

/// Runs `call` on a thread of its own and waits at most `limit`. Returns the reason of a failure,
/// or an empty text: `call` returns false with a reason, throws, or takes too long. After the
/// limit, `isCancelled` becomes true and the thread is left alone, so `call` must own all that it
/// uses. Refuses to call while kMaxAbandonedCalls are left.
[[nodiscard]] std::string callGuarded(std::function<bool(std::string& why)> call,
                                      std::chrono::milliseconds limit,
                                      const std::shared_ptr<std::atomic<bool>>& isCancelled,
                                      const AbandonedCalls& abandoned);

}  // namespace usdlive::edf
