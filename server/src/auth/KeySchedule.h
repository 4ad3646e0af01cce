// Decides when an issuer is asked for its keys, and how long they count.
#pragma once

#include <chrono>
#include <optional>

namespace usdlive::server {

/// The times at which the keys of an issuer are asked for (AC24). A value without a clock.
class KeySchedule {
public:
    using Time = std::chrono::steady_clock::time_point;
    using Duration = std::chrono::steady_clock::duration;

    static constexpr std::chrono::hours kRefresh{1};
    static constexpr std::chrono::hours kKeysLast{24};
    static constexpr std::chrono::seconds kFirstRetry{2}, kLongestRetry{60};
    /// The least time between two questions that tokens with an unknown key cause.
    static constexpr std::chrono::seconds kLookPause{30};

    /// Returns whether a token with an unknown key is a reason to ask now.
    [[nodiscard]] bool mayLook(Time now) const;
    /// Notes a question that such a token has caused.
    void looked(Time now) { lookedAt_ = now; }

    struct Next {
        Duration pause;         ///< until the next question
        bool isChange = false;  ///< the answer before was of the other kind, or there was none
        bool endsKeys = false;  ///< the present keys count no longer
    };
    /// The issuer has given its keys.
    [[nodiscard]] Next read(Time now);
    /// The issuer has given none.
    [[nodiscard]] Next failed(Time now);

    /// Returns whether there are keys that count.
    [[nodiscard]] bool hasKeys() const { return readAt_.has_value(); }

private:
    std::optional<Time> readAt_, lookedAt_;
    std::optional<bool> hasFailed_;  ///< the last answer
    Duration retry_ = kFirstRetry;
};

}  // namespace usdlive::server
