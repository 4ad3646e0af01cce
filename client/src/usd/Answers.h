// Answers of the server that a blocking call waits for.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "usdlive/client/session/Events.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// Answers by the numbers of their requests. Several requests may wait, when an event handler asks
/// while its caller waits.
class Answers {
public:
    void await(std::uint64_t request) { awaited_[request] = std::nullopt; }
    [[nodiscard]] bool isThere(std::uint64_t request) const {
        return awaited_.at(request).has_value();
    }
    /// Ends the wait. Nothing: there was no answer.
    [[nodiscard]] std::optional<Result<Event>> take(std::uint64_t request) {
        return std::move(awaited_.extract(request).mapped());
    }
    /// Ignores answers that nobody waits for.
    void add(std::uint64_t request, Result<Event> answer) {
        if (const auto found = awaited_.find(request); found != awaited_.end())
            found->second = std::move(answer);
    }

private:
    std::map<std::uint64_t, std::optional<Result<Event>>> awaited_;
};

}  // namespace usdlive::client
