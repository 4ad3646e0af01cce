// Limits what holders take of a resource together, and each of them alone.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>

namespace usdlive {

/// Counts what holders, such as sessions or addresses, take of a resource: bytes, seats, requests.
/// Its user decides what happens beyond a limit. The rule everywhere is: a holder beyond its own
/// limit gives way, and when all together are beyond theirs, the one with the most does. So nobody
/// can keep others out by taking everything. One thread.
template <class Holder>
class Budget {
public:
    static constexpr std::size_t kUnlimited = std::numeric_limits<std::size_t>::max();
    struct Limits {
        std::size_t each = kUnlimited;
        std::size_t all = kUnlimited;
    };

    Budget() = default;
    explicit Budget(const Limits& limits) : limits_(limits) {}

    void take(const Holder& holder, std::size_t amount) {
        if (amount == 0) return;
        held_[holder] += amount;
        used_ += amount;
    }
    /// Gives back at most what the holder has.
    void giveBack(const Holder& holder, std::size_t amount) {
        const auto found = held_.find(holder);
        if (found == held_.end()) return;
        amount = std::min(amount, found->second);
        used_ -= amount;
        if ((found->second -= amount) == 0) held_.erase(found);
    }
    void giveBackAll(const Holder& holder) { giveBack(holder, kUnlimited); }
    /// Sets what the holder has.
    void set(const Holder& holder, std::size_t amount) {
        giveBackAll(holder);
        take(holder, amount);
    }

    [[nodiscard]] std::size_t used() const { return used_; }
    [[nodiscard]] std::size_t of(const Holder& holder) const {
        const auto found = held_.find(holder);
        return found == held_.end() ? 0 : found->second;
    }
    [[nodiscard]] bool isOver(const Holder& holder) const { return of(holder) > limits_.each; }
    [[nodiscard]] bool isOver() const { return used_ > limits_.all; }
    /// Returns the holder that gives way: `taking`, which took something just now, if it is beyond
    /// its own limit; the one with the most, if all together are beyond theirs.
    [[nodiscard]] std::optional<Holder> givesWay(const Holder& taking) const {
        if (isOver(taking)) return taking;
        if (!isOver()) return std::nullopt;
        return std::ranges::max_element(held_, {}, [](const auto& one) { return one.second; })
            ->first;
    }

private:
    Limits limits_;
    std::map<Holder, std::size_t> held_;
    std::size_t used_ = 0;
};

}  // namespace usdlive
