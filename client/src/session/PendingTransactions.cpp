// The queue of own transactions that the server has not answered.
#include "session/PendingTransactions.h"

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
    if (!left.expectation.complete || !right.expectation.complete) return true;  // unknown
    const auto& theirs = right.expectation.touched;
    return std::any_of(
        left.expectation.touched.begin(), left.expectation.touched.end(), [&](const Touched& own) {
            return std::any_of(theirs.begin(), theirs.end(),
                               [&](const Touched& other) { return related(own, other); });
        });
}

// The most transactions and edits that writtenAgainBy() looks at.
constexpr std::size_t kLookedBack = 64, kEditsLookedAt = 4'096;

// Other edits of a spec or layer can depend on these fields.
constexpr std::string_view kDecisive[] = {"typeName", "specifier", "customLayerData"};

// True for an edit whose place in the order does not matter to other edits.
bool onlySets(const AuthoredEdit& edit) {
    const auto* set = std::get_if<SetField>(&edit.action);
    return set && setSameRegister(edit.action, edit.action) &&
           std::ranges::find(kDecisive, set->field) == std::end(kDecisive);
}

bool sameRegisters(const std::vector<AuthoredEdit>& earlier,
                   const std::vector<AuthoredEdit>& later) {
    return std::ranges::equal(earlier, later,
                              [](const AuthoredEdit& one, const AuthoredEdit& other) {
                                  return one.layer == other.layer && one.path == other.path &&
                                         setSameRegister(one.action, other.action);
                              });
}

std::string fieldKey(const AuthoredEdit& edit) {
    return edit.layer.value + '\n' + edit.path + '\n' + std::get<SetField>(edit.action).field;
}

// The server may refuse a transaction for a big value that it does not have. The transaction is
// then sent again, and later ones that build on it have to follow it.
bool holdsBack(const Pending& pending) { return !pending.blobs.empty(); }

}  // namespace

Pending& PendingTransactions::add(Pending pending) {
    count(pending);
    Pending& added = pending_.emplace_back(std::move(pending));
    if (onChange) onChange(added);
    return added;
}

void PendingTransactions::count(const Pending& pending) {
    numbers_.insert(pending.transaction.id.sequence);
    ++since_[neededSince(pending.transaction)];
    for (const AuthoredEdit& edit : pending.authored) ++edits_[edit.layer];
    if (pending.sent) ++sent_;
}

void PendingTransactions::discount(const Pending& pending) {
    numbers_.erase(pending.transaction.id.sequence);
    const auto since = since_.find(neededSince(pending.transaction));
    if (--since->second == 0) since_.erase(since);
    for (const AuthoredEdit& edit : pending.authored) {
        const auto layer = edits_.find(edit.layer);
        if (--layer->second == 0) edits_.erase(layer);
    }
    if (pending.sent) --sent_;
}

Pending* PendingTransactions::writtenAgainBy(const std::vector<AuthoredEdit>& edits) {
    if (named_ || pending_.empty() || pending_.back().everSent ||
        !std::ranges::all_of(edits, onlySets))
        return nullptr;
    std::unordered_set<std::string> fields;
    std::size_t transactions = 0, looked = edits.size();
    for (auto one = pending_.rbegin(); one != pending_.rend(); ++one) {
        looked += one->authored.size();
        if (one->everSent || one->transaction.gesture != 0 || ++transactions > kLookedBack ||
            looked > kEditsLookedAt)
            return nullptr;
        if (sameRegisters(one->authored, edits)) return &*one;
        if (fields.empty())
            for (const AuthoredEdit& edit : edits) fields.insert(fieldKey(edit));
        const bool stops = std::ranges::any_of(one->authored, [&](const AuthoredEdit& edit) {
            return !onlySets(edit) || fields.contains(fieldKey(edit));
        });
        if (stops) return nullptr;
    }
    return nullptr;
}

Pending* PendingTransactions::find(std::uint64_t sequence) {
    if (!contains(sequence)) return nullptr;
    return &*std::find_if(pending_.begin(), pending_.end(), hasSequence(sequence));
}

bool PendingTransactions::isFirst(std::uint64_t sequence) const {
    return !pending_.empty() && pending_.front().transaction.id.sequence == sequence;
}

std::optional<Pending> PendingTransactions::take(std::uint64_t sequence) {
    if (!contains(sequence)) return std::nullopt;
    const auto found = std::find_if(pending_.begin(), pending_.end(), hasSequence(sequence));
    Pending taken = std::move(*found);
    pending_.erase(found);
    discount(taken);
    if (onTake) onTake(sequence);
    return taken;
}

std::deque<Pending> PendingTransactions::takeAll() {
    sent_ = 0;
    numbers_.clear();
    since_.clear();
    edits_.clear();
    return std::exchange(pending_, {});
}

Revision PendingTransactions::oldestNeeded(Revision otherwise) const {
    return since_.empty() ? otherwise : std::min(otherwise, since_.begin()->first);
}

void PendingTransactions::rebase(Pending& pending, Revision base) {
    const auto before = since_.find(neededSince(pending.transaction));
    if (--before->second == 0) since_.erase(before);
    pending.transaction.base = base;
    ++since_[neededSince(pending.transaction)];
}

void PendingTransactions::markSent(Pending& pending, std::size_t bytes) {
    pending.sent = pending.everSent = true;
    pending.changedSince = false;
    pending.sentBytes = bytes;
    ++sent_;
}

void PendingTransactions::markUnsent(Pending& pending) {
    if (std::exchange(pending.sent, false)) --sent_;
}

void PendingTransactions::markAllUnsent() {
    for (auto pending = pending_.begin(); sent_ > 0; ++pending) markUnsent(*pending);
}

std::vector<Pending*> PendingTransactions::sendable(
    const std::function<bool(const Pending&)>& ready, bool known) {
    std::vector<Pending*> free;
    std::vector<Pending*> waiting;
    std::size_t inFlight = 0, bytes = 0;
    std::uint64_t lowest = pending_.empty() ? 0 : pending_.front().transaction.id.sequence;
    for (Pending& pending : pending_) {
        // The limit also counts numbers from the first transaction that waits: the server must
        // still recognize that one if it is sent twice.
        const std::uint64_t number = pending.transaction.id.sequence;
        lowest = std::min(lowest, number);
        if (++inFlight > kMaxInFlight || number >= lowest + kMaxInFlight) break;
        if (pending.sent) {
            bytes += pending.sentBytes;
            if (holdsBack(pending)) waiting.push_back(&pending);
            continue;
        }
        if (bytes >= kMaxBytesInFlight) break;
        const bool waits = !ready(pending) || (!known && !waiting.empty()) ||
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
