// The end of the time that one call may take.
#pragma once

#include <cstddef>

#include "session/Session.h"

namespace usdlive::client {

/// The end of one Session::advance(), by the clock of the options.
class Deadline {
public:
    explicit Deadline(const Session::Options& options) : options_(options) {}

    void set(double budgetMs) { atMs_ = options_.clockMs() + budgetMs; }
    [[nodiscard]] bool isOver() const { return options_.clockMs() >= atMs_; }
    /// Before transaction number `count` of a loop. The first `leastAtOnce` have time, and the
    /// clock is read only now and then.
    [[nodiscard]] bool isOver(std::size_t count) const {
        constexpr std::size_t kClockEvery = 8;
        return count > options_.leastAtOnce && count % kClockEvery == 1 && isOver();
    }

private:
    const Session::Options& options_;
    double atMs_ = 0;
};

}  // namespace usdlive::client
