#include "PendingTransactions.h"

#include <algorithm>

namespace usdlive::client {

namespace {

auto hasSequence(std::uint64_t sequence) {
    return
        [sequence](const Pending& pending) { return pending.transaction.id.sequence == sequence; };
}

bool related(const Touched& left, const Touched& right) {
    return left.layer == right.layer && (specpath::hasPrefix(left.path, right.path) ||
                                         specpath::hasPrefix(right.path, left.path));
}

bool overlap(const Pending& left, const Pending& right) {
    if (!left.prognosis.complete || !right.prognosis.complete) return true;  // not known
    const auto& theirs = right.prognosis.touched;
    return std::any_of(
        left.prognosis.touched.begin(), left.prognosis.touched.end(), [&](const Touched& own) {
            return std::any_of(theirs.begin(), theirs.end(),
                               [&](const Touched& other) { return related(own, other); });
        });
}

// The server may refuse a transaction for a big value that it does not hold. It is then sent again,
// and what builds on it has to come after it.
bool holdsBack(const Pending& pending) { return !pending.blobs.empty(); }

}  // namespace

Pending& PendingTransactions::add(Pending pending) {
    Pending& added = pending_.emplace_back(std::move(pending));
    if (onAdd) onAdd(added);
    return added;
}

Pending* PendingTransactions::find(std::uint64_t sequence) {
    const auto found = std::find_if(pending_.begin(), pending_.end(), hasSequence(sequence));
    return found == pending_.end() ? nullptr : &*found;
}

bool PendingTransactions::isFirst(std::uint64_t sequence) const {
    return !pending_.empty() && pending_.front().transaction.id.sequence == sequence;
}

std::optional<Pending> PendingTransactions::take(std::uint64_t sequence) {
    const auto found = std::find_if(pending_.begin(), pending_.end(), hasSequence(sequence));
    if (found == pending_.end()) return std::nullopt;
    Pending taken = std::move(*found);
    pending_.erase(found);
    if (onTake) onTake(sequence);
    return taken;
}

std::size_t PendingTransactions::unsent() const {
    return std::size_t(std::count_if(pending_.begin(), pending_.end(),
                                     [](const Pending& pending) { return !pending.sent; }));
}

bool PendingTransactions::touches(const LayerId& layer) const {
    return std::any_of(pending_.begin(), pending_.end(), [&](const Pending& pending) {
        return std::any_of(pending.authored.begin(), pending.authored.end(),
                           [&](const AuthoredEdit& edit) { return edit.layer == layer; });
    });
}

Revision PendingTransactions::oldestBase(Revision otherwise) const {
    for (const Pending& pending : pending_)
        otherwise = std::min(otherwise, pending.transaction.base);
    return otherwise;
}

void PendingTransactions::markUnsent(bool reseal) {
    for (Pending& pending : pending_) {
        pending.sent = false;
        pending.reseal = pending.reseal || reseal;
    }
}

std::vector<Pending*> PendingTransactions::sendable(
    const std::function<bool(const Pending&)>& ready) {
    std::vector<Pending*> free;
    std::vector<Pending*> waiting;
    std::size_t onTheirWay = 0, bytes = 0;
    for (Pending& pending : pending_) {
        if (pending.sent) {
            ++onTheirWay;
            bytes += pending.sentBytes;
            if (holdsBack(pending)) waiting.push_back(&pending);
            continue;
        }
        if (onTheirWay + free.size() >= kMaxOnTheirWay || bytes >= kMaxBytesOnTheirWay) break;
        const bool waits = !ready(pending) ||
                           std::any_of(waiting.begin(), waiting.end(),
                                       [&](Pending* other) { return overlap(*other, pending); });
        if (waits) {
            waiting.push_back(&pending);
            continue;
        }
        free.push_back(&pending);
        if (holdsBack(pending)) waiting.push_back(&pending);
    }
    return free;
}

}  // namespace usdlive::client
