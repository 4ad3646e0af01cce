// Translates paths through recorded moves and deletes (M3).
#include <algorithm>

#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive {

namespace {

constexpr std::uint64_t kFew = 32;  // so few entries are searched one by one
constexpr std::uint64_t kNoEnd = ~std::uint64_t(0);
constexpr std::size_t kMostNamings = 65'536;

}  // namespace

void NamespaceLog::recordMove(Revision revision, const LayerId& layer, std::string from,
                              std::string to, Of what, Author author) {
    record({revision, layer, std::move(from), std::move(to), what, author});
}

void NamespaceLog::recordDelete(Revision revision, const LayerId& layer, std::string path, Of what,
                                Author author) {
    record({revision, layer, std::move(path), std::nullopt, what, author});
}

void NamespaceLog::record(Entry entry) {
    byPath_[entry.layer].emplace(entry.from, mark());
    if (entry.what == Of::Place) lastPlace_ = mark() + 1;
    entries_.push_back(std::move(entry));
}

std::uint64_t NamespaceLog::markAfter(Revision revision) const {
    if (below_) return below_->markAfter(revision);
    if (entries_.empty() || entries_.back().revision <= revision) return mark();
    const auto later = std::upper_bound(
        entries_.begin(), entries_.end(), revision,
        [](Revision wanted, const Entry& entry) { return wanted < entry.revision; });
    return first_ + static_cast<std::uint64_t>(later - entries_.begin());
}

std::optional<std::string> NamespaceLog::translate(const LayerId& layer, std::string path,
                                                   Revision since) const {
    return translateFrom(layer, std::move(path), markAfter(since));
}

std::optional<std::string> NamespaceLog::translateFrom(const LayerId& layer, std::string path,
                                                       std::uint64_t mark) const {
    return walk(layer, std::move(path), mark, kNoEnd, Follow::All);
}

std::optional<std::string> NamespaceLog::translatePlace(const LayerId& layer, std::string path,
                                                        std::uint64_t mark) const {
    return walk(layer, std::move(path), mark, kNoEnd, Follow::ForPlace);
}

std::string NamespaceLog::translateVacated(const LayerId& layer, std::string path,
                                           std::uint64_t mark) const {
    return *walk(layer, std::move(path), mark, kNoEnd, Follow::Vacated);
}

std::optional<std::string> NamespaceLog::translatePlaceBetween(const LayerId& layer,
                                                               std::string path, std::uint64_t mark,
                                                               std::uint64_t end,
                                                               Author author) const {
    return walk(layer, std::move(path), mark, end, Follow::OthersPlaces, author);
}

std::optional<std::string> NamespaceLog::walk(const LayerId& layer, std::string path,
                                              std::uint64_t mark, std::uint64_t end, Follow follow,
                                              Author author) const {
    if (below_ && mark < kFirstAbove) {
        auto confirmed = below_->walk(layer, std::move(path), mark, end, follow, author);
        if (!confirmed) return std::nullopt;
        path = *std::move(confirmed);
    }
    for (auto next = firstConcerning(layer, path, std::max(mark, first_)); next && *next < end;
         next = firstConcerning(layer, path, *next + 1)) {
        const Entry& entry = entries_[*next - first_];
        const bool isOfSpec = entry.what == Of::Spec;
        const bool isForPlace = follow == Follow::ForPlace || follow == Follow::Vacated;
        if (isForPlace && isOfSpec && entry.from == path) continue;
        if (follow == Follow::OthersPlaces && (isOfSpec || entry.author == author)) continue;
        if (!entry.to && follow == Follow::Vacated) continue;
        if (!entry.to) return std::nullopt;
        path = specpath::replacePrefix(path, entry.from, *entry.to);
    }
    return path;
}

NamespaceLog::Followed NamespaceLog::followPlace(const LayerId& layer, std::string place,
                                                 std::string above, std::uint64_t mark,
                                                 std::uint64_t end, Author author) const {
    Followed followed{std::move(place), std::move(above)};
    if (below_ && mark < kFirstAbove) {
        followed = below_->followPlace(layer, *std::move(followed.place),
                                       *std::move(followed.above), mark, end, author);
        if (!followed.place || followed.left) return followed;
    }
    for (auto next = firstConcerning(layer, *followed.place, std::max(mark, first_));
         next && *next < end; next = firstConcerning(layer, *followed.place, *next + 1)) {
        const Entry& entry = entries_[*next - first_];
        if (entry.what == Of::Spec || entry.author == author) continue;
        const auto moved = [&](const std::string& path) -> std::optional<std::string> {
            if (!specpath::hasPrefix(path, entry.from)) return path;
            if (!entry.to) return std::nullopt;
            return specpath::replacePrefix(path, entry.from, *entry.to);
        };
        followed = {moved(*followed.place), moved(*followed.above)};
        if (!followed.place) return followed;
        if (specpath::hasPrefix(*followed.place, *followed.above)) continue;
        followed.left = *next + 1;
        return followed;
    }
    return followed;
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

bool NamespaceLog::isEntry(std::uint64_t number, const Edit& executed) const {
    if (number < first_ || number >= mark() || !changesNamespace(executed)) return false;
    const Entry& entry = entries_[number - first_];
    if (entry.layer != executed.layer || entry.from != executed.address.path) return false;
    const auto* move = std::get_if<MoveSpec>(&executed.action);
    return move ? entry.to == destination(entry.from, *move) : !entry.to;
}

void NamespaceLog::truncate(std::uint64_t mark) {
    while (!entries_.empty() && this->mark() > mark) {
        dropFromIndex(this->mark() - 1, entries_.back());
        entries_.pop_back();
    }
    while (!namings_.empty() && namings_.back().mark > mark) namings_.pop_back();
}

void NamespaceLog::prune(Revision revision) {
    while (!entries_.empty() && entries_.front().revision <= revision) forgetFirst();
    oldest_ = std::max(oldest_, revision);
    while (!namings_.empty() && namings_.front().revision <= revision) namings_.pop_front();
    namingsSince_ = std::max(namingsSince_, revision);
}

void NamespaceLog::pruneBefore(std::uint64_t mark) {
    while (!entries_.empty() && first_ < mark) forgetFirst();
}

void NamespaceLog::recordNaming(Revision revision, const LayerId& layer, const std::string& path,
                                std::string_view field, Author author) {
    if (below_) return;
    if (!namings_.empty()) {  // many edits of one list
        const Naming& last = namings_.back();
        if (last.revision == revision && last.path == path && last.field == field &&
            last.layer == layer && last.mark == mark())
            return;
    }
    namings_.push_back({revision, layer, path, std::string(field), mark(), author});
    if (namings_.size() <= kMostNamings) return;
    namingsSince_ = namings_.front().revision;
    while (!namings_.empty() && namings_.front().revision == namingsSince_) namings_.pop_front();
}

bool NamespaceLog::forEachNaming(
    const LayerId& layer, Revision since, Author author,
    const std::function<void(std::string path, const std::string& field)>& visit) const {
    if (below_)
        return below_->forEachNaming(
            layer, since, author, [&](std::string path, const auto& field) {
                if (auto now = translateFrom(layer, std::move(path), first_))
                    visit(*std::move(now), field);
            });
    const auto first = std::upper_bound(
        namings_.begin(), namings_.end(), since,
        [](Revision wanted, const Naming& naming) { return wanted < naming.revision; });
    for (auto naming = first; naming != namings_.end(); ++naming)
        if (naming->layer == layer && naming->author != author)
            if (auto path = translateFrom(layer, naming->path, naming->mark))
                visit(*std::move(path), naming->field);
    return since >= namingsSince_;
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
