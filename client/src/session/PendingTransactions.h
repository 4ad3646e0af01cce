// The queue of own transactions that the server has not answered.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "session/Pending.h"

namespace usdlive::client {

/// Own transactions that the server has not answered, in the order in which they were made. There
/// can be a million of them, so no function looks at all of them.
class PendingTransactions {
public:
    /// The most transactions that are sent and not answered: a server recognizes a transaction that
    /// is sent twice (M9) among the last 1,024 of its author. The others wait here.
    static constexpr std::size_t kMaxInFlight = 1'000;
    /// The most bytes of them.
    static constexpr std::size_t kMaxBytesInFlight = 64 * 1024 * 1024;

    [[nodiscard]] std::uint64_t nextSequence() {
        named_ = false;
        return ++lastSequence_;
    }
    void setNextSequence(std::uint64_t sequence) {
        lastSequence_ = sequence - 1;
        named_ = true;
    }
    /// Returns the transaction that these edits may replace (SE15), because they set exactly its
    /// registers; or nullptr. It was never sent, and no later one writes these registers.
    [[nodiscard]] Pending* writtenAgainBy(const std::vector<AuthoredEdit>& edits);

    Pending& add(Pending pending);
    [[nodiscard]] bool contains(std::uint64_t sequence) const {
        return numbers_.contains(sequence);
    }
    /// Searches from the front, where the sent transactions are.
    [[nodiscard]] Pending* find(std::uint64_t sequence);
    [[nodiscard]] bool isFirst(std::uint64_t sequence) const;
    std::optional<Pending> take(std::uint64_t sequence);
    [[nodiscard]] std::deque<Pending> takeAll();

    [[nodiscard]] bool empty() const { return pending_.empty(); }
    [[nodiscard]] std::size_t size() const { return pending_.size(); }
    [[nodiscard]] auto begin() { return pending_.begin(); }
    [[nodiscard]] auto end() { return pending_.end(); }
    [[nodiscard]] auto begin() const { return pending_.begin(); }
    [[nodiscard]] auto end() const { return pending_.end(); }
    [[nodiscard]] Pending& operator[](std::size_t index) { return pending_[index]; }
    [[nodiscard]] std::size_t sent() const { return sent_; }
    [[nodiscard]] std::size_t unsent() const { return pending_.size() - sent_; }
    [[nodiscard]] bool touches(const LayerId& layer) const { return edits_.contains(layer); }
    /// The oldest neededSince() of these transactions, or `otherwise`.
    [[nodiscard]] Revision oldestNeeded(Revision otherwise) const;

    /// Changes the base of a transaction.
    void rebase(Pending& pending, Revision base);
    void markSent(Pending& pending, std::size_t bytes);
    void markUnsent(Pending& pending);
    /// Called when the connection is lost.
    void markAllUnsent();

    /// Returns the transactions that may be sent now, in order. A transaction that is not `ready`
    /// (the server does not have all its big values) waits. A later one waits, too, if it touches a
    /// spec above or below one of a transaction that waits, or that names big values and is not
    /// answered. Without `known` (the touched specs are known) all later ones wait.
    [[nodiscard]] std::vector<Pending*> sendable(const std::function<bool(const Pending&)>& ready,
                                                 bool known);

    /// Called with each transaction that is added or changed, and with the number of each taken
    /// one.
    std::function<void(const Pending&)> onChange;
    std::function<void(std::uint64_t)> onTake;

private:
    void count(const Pending& pending);
    void discount(const Pending& pending);

    std::deque<Pending> pending_;
    std::uint64_t lastSequence_ = 0;
    bool named_ = false;  // setNextSequence() has set the number of the next one
    std::size_t sent_ = 0;
    std::unordered_set<std::uint64_t> numbers_;
    std::map<Revision, std::size_t> since_;           // number of transactions by neededSince()
    std::unordered_map<LayerId, std::size_t> edits_;  // number of edits by layer
};

}  // namespace usdlive::client
