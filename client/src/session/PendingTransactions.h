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

#include "Pending.h"

namespace usdlive::client {

/// One's own transactions that the server has not answered, in the order they were made. There may
/// be a million of them, so nothing here looks at all of them.
class PendingTransactions {
public:
    /// At most so many are on their way at once: a server recognizes a transaction that is sent
    /// twice (M9) among the last 1,024 of its author. The others wait here.
    static constexpr std::size_t kMaxOnTheirWay = 1'000;
    /// As many bytes; then the next is sent only when those before are answered.
    static constexpr std::size_t kMaxBytesOnTheirWay = 64 * 1024 * 1024;

    [[nodiscard]] std::uint64_t nextSequence() {
        named_ = false;
        return ++lastSequence_;
    }
    void setNextSequence(std::uint64_t sequence) {
        lastSequence_ = sequence - 1;
        named_ = true;
    }
    /// The transaction of which these edits leave nothing, as they set the same registers, or
    /// nullptr. It was never sent, and none after it has to do with these registers, so the edits
    /// can take its place.
    [[nodiscard]] Pending* writtenAgainBy(const std::vector<AuthoredEdit>& edits);

    Pending& add(Pending pending);
    [[nodiscard]] bool contains(std::uint64_t sequence) const {
        return numbers_.contains(sequence);
    }
    /// Looks from the front, where those are that have been sent.
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
    [[nodiscard]] std::size_t unsent() const { return pending_.size() - sent_; }
    [[nodiscard]] bool touches(const LayerId& layer) const { return edits_.contains(layer); }
    /// The oldest revision an address of them is meant as of.
    [[nodiscard]] Revision oldestBase(Revision otherwise) const;

    /// Changes the revision that its addresses are meant as of.
    void rebase(Pending& pending, Revision base);
    void markSent(Pending& pending, std::size_t bytes);
    void markUnsent(Pending& pending);
    /// The connection is gone.
    void markAllUnsent();

    /// What may be sent now, in order. A transaction that is not `ready` (its big values are not
    /// all on the server) waits. Every later one that touches a spec above or below one of the
    /// specs of one that waits, or that names big values and is not answered, waits, too; all later
    /// ones unless `known` (what they touch).
    [[nodiscard]] std::vector<Pending*> sendable(const std::function<bool(const Pending&)>& ready,
                                                 bool known);

    /// Called with each that is added, and with the number of each that is taken.
    std::function<void(const Pending&)> onAdd;
    std::function<void(std::uint64_t)> onTake;

private:
    void count(const Pending& pending);
    void discount(const Pending& pending);

    std::deque<Pending> pending_;
    std::uint64_t lastSequence_ = 0;
    bool named_ = false;  // the next one has a number that its author knows
    std::size_t sent_ = 0;
    std::unordered_set<std::uint64_t> numbers_;
    std::map<Revision, std::size_t> bases_;           // how many have it
    std::unordered_map<LayerId, std::size_t> edits_;  // of each layer
};

}  // namespace usdlive::client
