// The clock of the simulation and its planned actions.
#pragma once

#include <cstdint>
#include <functional>
#include <queue>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace usdlive::simulation {

/// Thrown when a rule is broken.
struct SimFailure : std::runtime_error {
    using std::runtime_error::runtime_error;
};

inline void require(bool holds, const std::string& what) {
    if (!holds) throw SimFailure(what);
}

/// The time of a simulated world, and its planned events. Events of the same moment happen in the
/// order in which they were planned.
class SimClock {
public:
    [[nodiscard]] std::int64_t nowUs() const { return nowUs_; }
    [[nodiscard]] std::int64_t nowMs() const { return nowUs_ / 1000; }

    void at(std::int64_t timeUs, std::function<void()> what) {
        plan_.push({std::max(timeUs, nowUs_), ++planned_, std::move(what)});
    }
    void in(std::int64_t delayUs, std::function<void()> what) {
        at(nowUs_ + delayUs, std::move(what));
    }
    /// Runs the next event. Returns false if nothing is planned.
    bool step() {
        if (plan_.empty()) return false;
        Happening next = std::move(const_cast<Happening&>(plan_.top()));
        plan_.pop();
        nowUs_ = next.timeUs;
        next.what();
        return true;
    }

private:
    struct Happening {
        std::int64_t timeUs;
        std::uint64_t number;
        std::function<void()> what;
        bool operator<(const Happening& other) const {
            return std::pair(timeUs, number) > std::pair(other.timeUs, other.number);
        }
    };
    std::priority_queue<Happening> plan_;
    std::int64_t nowUs_ = 0;
    std::uint64_t planned_ = 0;
};

}  // namespace usdlive::simulation
