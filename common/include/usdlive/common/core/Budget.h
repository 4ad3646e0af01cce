// Limits what holders take of a resource together, and each of them alone.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <string>

namespace usdlive {

/// Counts what holders, such as sessions or addresses, take of a resource: bytes, seats, requests.
/// A holder may belong to a group, such as all sessions of one user. Its user decides what happens
/// beyond a limit. The rule everywhere is: a holder beyond its own limit gives way; in a group
/// beyond its limit the holder with the most; and when all together are beyond theirs, the one with
/// the most in the group with the most. So nobody can keep others out by taking everything, nor by
/// opening many sessions. One thread.
template <class Holder>
class Budget {
public:
    static constexpr std::size_t kUnlimited = std::numeric_limits<std::size_t>::max();
    struct Limits {
        std::size_t each = kUnlimited;
        std::size_t group = kUnlimited;
        std::size_t all = kUnlimited;
    };

    Budget() = default;
    explicit Budget(const Limits& limits) : limits_(limits) {}

    /// A holder stays in its group until it has given everything back. An empty name is no group,
    /// and has no limit.
    void take(const Holder& holder, std::size_t amount, const std::string& group = {}) {
        if (amount == 0) return;
        Held& held = held_.try_emplace(holder, Held{0, group}).first->second;
        held.amount += amount;
        groups_[held.group] += amount;
        used_ += amount;
    }
    /// Gives back at most what the holder has.
    void giveBack(const Holder& holder, std::size_t amount) {
        const auto found = held_.find(holder);
        if (found == held_.end()) return;
        Held& held = found->second;
        amount = std::min(amount, held.amount);
        used_ -= amount;
        const auto group = groups_.find(held.group);
        if ((group->second -= amount) == 0) groups_.erase(group);
        if ((held.amount -= amount) == 0) held_.erase(found);
    }
    void giveBackAll(const Holder& holder) { giveBack(holder, kUnlimited); }
    /// Sets what the holder has.
    void set(const Holder& holder, std::size_t amount, const std::string& group = {}) {
        giveBackAll(holder);
        take(holder, amount, group);
    }

    [[nodiscard]] std::size_t used() const { return used_; }
    [[nodiscard]] std::size_t of(const Holder& holder) const {
        const auto found = held_.find(holder);
        return found == held_.end() ? 0 : found->second.amount;
    }
    [[nodiscard]] std::size_t ofGroup(const std::string& group) const {
        const auto found = groups_.find(group);
        return found == groups_.end() ? 0 : found->second;
    }
    [[nodiscard]] bool isOver(const Holder& holder) const { return of(holder) > limits_.each; }
    [[nodiscard]] bool isOver() const { return used_ > limits_.all; }
    /// Returns the holder that gives way after `taking` took something; nothing if nobody has to.
    [[nodiscard]] std::optional<Holder> givesWay(const Holder& taking) const {
        if (isOver(taking)) return taking;
        const auto holder = held_.find(taking);
        const std::string group = holder == held_.end() ? std::string() : holder->second.group;
        if (!group.empty() && ofGroup(group) > limits_.group) return most(group);
        if (!isOver()) return std::nullopt;
        return most(std::ranges::max_element(groups_, {}, &Groups::value_type::second)->first);
    }

private:
    struct Held {
        std::size_t amount = 0;
        std::string group;
    };
    using Groups = std::map<std::string, std::size_t>;

    [[nodiscard]] Holder most(const std::string& group) const {
        return std::ranges::max_element(held_, {},
                                        [&](const auto& one) {
                                            return one.second.group == group ? one.second.amount
                                                                             : 0;
                                        })
            ->first;
    }

    Limits limits_;
    std::map<Holder, Held> held_;
    Groups groups_;
    std::size_t used_ = 0;
};

}  // namespace usdlive
