// The answers of the server for which blocking calls wait.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "usdlive/client/session/Events.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// The answers by the numbers of their requests. Several requests may wait at the same time if an
/// event handler makes one while a blocking call dispatches events.
class AwaitedAnswers {
public:
    void await(std::uint64_t request) { awaited_[request] = std::nullopt; }
    [[nodiscard]] bool isAwaited(std::uint64_t request) const { return awaited_.contains(request); }
    [[nodiscard]] bool isThere(std::uint64_t request) const {
        return awaited_.at(request).has_value();
    }
    /// Ends the wait. Returns nothing if there was no answer.
    [[nodiscard]] std::optional<Result<Event>> take(std::uint64_t request) {
        return std::move(awaited_.extract(request).mapped());
    }
    /// Keeps an answer. Ignores one for which no call waits.
    void add(std::uint64_t request, Result<Event> answer) {
        if (const auto found = awaited_.find(request); found != awaited_.end())
            found->second = std::move(answer);
    }

private:
    std::map<std::uint64_t, std::optional<Result<Event>>> awaited_;
};

}  // namespace usdlive::client
