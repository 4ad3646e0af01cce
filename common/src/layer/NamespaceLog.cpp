// Translates paths through recorded moves and deletes (M3).
#include <algorithm>

#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive {

namespace {

constexpr std::uint64_t kFew = 32;  // so few entries are searched one by one

}  // namespace

void NamespaceLog::recordMove(Revision revision, const LayerId& layer, std::string from,
                              std::string to) {
    record({revision, layer, std::move(from), std::move(to)});
}

void NamespaceLog::recordDelete(Revision revision, const LayerId& layer, std::string path) {
    record({revision, layer, std::move(path), std::nullopt});
}

void NamespaceLog::record(Entry entry) {
    byPath_[entry.layer].emplace(entry.from, mark());
    entries_.push_back(std::move(entry));
}

std::optional<std::string> NamespaceLog::translate(const LayerId& layer, std::string path,
                                                   Revision since) const {
    if (below_) {
        auto confirmed = below_->translate(layer, std::move(path), since);
        return confirmed ? translateFrom(layer, *std::move(confirmed), first_) : std::nullopt;
    }
    if (entries_.empty() || entries_.back().revision <= since) return path;
    const auto later = std::upper_bound(
        entries_.begin(), entries_.end(), since,
        [](Revision revision, const Entry& entry) { return revision < entry.revision; });
    return translateFrom(layer, std::move(path),
                         first_ + static_cast<std::uint64_t>(later - entries_.begin()));
}

std::optional<std::string> NamespaceLog::translateFrom(const LayerId& layer, std::string path,
                                                       std::uint64_t mark) const {
    if (below_ && mark < kFirstAbove) {
        auto confirmed = below_->translateFrom(layer, std::move(path), mark);
        if (!confirmed) return std::nullopt;
        path = *std::move(confirmed);
    }
    for (auto next = firstConcerning(layer, path, std::max(mark, first_)); next;
         next = firstConcerning(layer, path, *next + 1)) {
        const Entry& entry = entries_[*next - first_];
        if (!entry.to) return std::nullopt;
        path = specpath::replacePrefix(path, entry.from, *entry.to);
    }
    return path;
}

// Returns the first entry from `mark` on that moved or deleted the spec at `path` or an ancestor.
std::optional<std::uint64_t> NamespaceLog::firstConcerning(const LayerId& layer,
                                                           std::string_view path,
                                                           std::uint64_t mark) const {
    const std::uint64_t few = std::min(this->mark(), mark + kFew);
    for (std::uint64_t number = mark; number < few; ++number) {
        const Entry& entry = entries_[number - first_];
        if (specpath::hasPrefix(path, entry.from) && entry.layer == layer) return number;
    }
    if (few == this->mark()) return std::nullopt;
    const auto index = byPath_.find(layer);
    if (index == byPath_.end()) return std::nullopt;

    std::optional<std::uint64_t> first;
    for (std::string above(path); above.size() > 1; above = specpath::parent(above)) {
        const auto found = index->second.lower_bound({above, few});
        const bool concerns = found != index->second.end() && found->first == above;
        if (concerns && (!first || found->second < *first)) first = found->second;
    }
    return first;
}

std::uint64_t NamespaceLog::mark() const { return first_ + entries_.size(); }

void NamespaceLog::truncate(std::uint64_t mark) {
    while (!entries_.empty() && this->mark() > mark) {
        dropFromIndex(this->mark() - 1, entries_.back());
        entries_.pop_back();
    }
}

void NamespaceLog::prune(Revision revision) {
    while (!entries_.empty() && entries_.front().revision <= revision) forgetFirst();
    oldest_ = std::max(oldest_, revision);
}

void NamespaceLog::pruneBefore(std::uint64_t mark) {
    while (!entries_.empty() && first_ < mark) forgetFirst();
}

void NamespaceLog::forgetFirst() {
    dropFromIndex(first_, entries_.front());
    entries_.pop_front();
    ++first_;
}

void NamespaceLog::dropFromIndex(std::uint64_t number, const Entry& entry) {
    const auto index = byPath_.find(entry.layer);
    index->second.erase({entry.from, number});
    if (index->second.empty()) byPath_.erase(index);
}

void OwnCreations::record(const Creation& creation, Entry entry, Revision revision) {
    entries_.insert_or_assign(creation, Kept{std::move(entry), revision});
}

const OwnCreations::Entry* OwnCreations::find(const Creation& creation) const {
    if (const Entry* entry = below_ ? below_->find(creation) : nullptr) return entry;
    const auto found = entries_.find(creation);
    return found == entries_.end() ? nullptr : &found->second.entry;
}

void OwnCreations::seen(Revision revision) {
    std::erase_if(entries_, [&](const auto& item) { return item.second.revision <= revision; });
}

void OwnCreations::forget(std::uint64_t sequence) {
    entries_.erase(entries_.lower_bound({sequence, 0}), entries_.lower_bound({sequence + 1, 0}));
}

}  // namespace usdlive
