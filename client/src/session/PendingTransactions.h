#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "Pending.h"

namespace usdlive::client {

/// One's own transactions that the server has not answered, in the order they were made.
class PendingTransactions {
public:
    /// So many are on their way at once: a server knows a transaction that is sent twice (M9) among
    /// the last 1,024 of its author. The others wait here.
    static constexpr std::size_t kMaxOnTheirWay = 1'000;
    /// As many bytes; then what is one's turn only goes when those before are answered.
    static constexpr std::size_t kMaxBytesOnTheirWay = 64 * 1024 * 1024;

    [[nodiscard]] std::uint64_t nextSequence() { return ++lastSequence_; }
    void setNextSequence(std::uint64_t sequence) { lastSequence_ = sequence - 1; }

    Pending& add(Pending pending);
    [[nodiscard]] Pending* find(std::uint64_t sequence);
    [[nodiscard]] bool isFirst(std::uint64_t sequence) const;
    std::optional<Pending> take(std::uint64_t sequence);
    [[nodiscard]] std::deque<Pending> takeAll() { return std::exchange(pending_, {}); }

    [[nodiscard]] bool empty() const { return pending_.empty(); }
    [[nodiscard]] std::size_t size() const { return pending_.size(); }
    [[nodiscard]] auto begin() { return pending_.begin(); }
    [[nodiscard]] auto end() { return pending_.end(); }
    [[nodiscard]] auto begin() const { return pending_.begin(); }
    [[nodiscard]] auto end() const { return pending_.end(); }
    [[nodiscard]] std::size_t unsent() const;
    [[nodiscard]] bool touches(const LayerId& layer) const;
    /// The oldest revision an address of them is meant as of.
    [[nodiscard]] Revision oldestBase(Revision otherwise) const;

    /// The connection is gone, or everything has to be addressed anew before it is sent.
    void markUnsent(bool reseal);

    /// What may be sent now, in order. A transaction that is not `ready` (its big values are not
    /// all on the server) waits. Every later one that touches a spec above or below one of the
    /// specs of one that waits, or that names big values and is not answered, waits, too.
    [[nodiscard]] std::vector<Pending*> sendable(const std::function<bool(const Pending&)>& ready);

    /// Called with each that is added, and with the number of each that is taken.
    std::function<void(const Pending&)> onAdd;
    std::function<void(std::uint64_t)> onTake;

private:
    std::deque<Pending> pending_;
    std::uint64_t lastSequence_ = 0;
};

}  // namespace usdlive::client
