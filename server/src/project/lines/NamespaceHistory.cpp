// Keeps the moves and deletes of a line of history.
#include "lines/NamespaceHistory.h"

#include <algorithm>

namespace usdlive::server {

NamespaceHistory::NamespaceHistory(Revision oldest, Revision newest,
                                   const std::vector<NamespaceChange>& changes) {
    log_.prune(oldest);
    for (const auto& [revision, layer, from, to] : changes) {
        if (revision <= oldest || revision > newest) continue;
        if (to)
            log_.recordMove(revision, layer, from, *to);
        else
            log_.recordDelete(revision, layer, from);
        executed(revision);
    }
}

void NamespaceHistory::executed(Revision revision) {
    for (; end_ < log_.mark(); ++end_) revisions_.push_back(revision);
}

void NamespaceHistory::truncate(std::uint64_t mark) {
    log_.truncate(mark);
    for (; end_ > mark; --end_) revisions_.pop_back();
}

void NamespaceHistory::prune(Revision revision) {
    log_.prune(revision);
    while (!revisions_.empty() && revisions_.front() <= revision) revisions_.pop_front();
}

std::uint64_t NamespaceHistory::markBefore(Revision revision) const {
    const auto later = std::lower_bound(revisions_.begin(), revisions_.end(), revision);
    return end_ - std::uint64_t(revisions_.end() - later);
}

}  // namespace usdlive::server
