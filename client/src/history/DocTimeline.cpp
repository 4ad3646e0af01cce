// Layers at each revision of a part of the history.
#include "history/DocTimeline.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace usdlive::client {

void DocTimeline::start(LayerDocs docs, Revision revision) {
    first_ = revision;
    commits_.clear();
    kept_.clear();
    recent_ = docs;
    recentAt_ = revision;
    kept_.emplace(revision, std::move(docs));
}

void DocTimeline::add(std::vector<Commit> commits) {
    std::ranges::move(commits, std::back_inserter(commits_));
}

Result<LayerDocs> DocTimeline::at(Revision revision) {
    const auto kept = std::prev(kept_.upper_bound(revision));
    const bool isNear = recentAt_ <= revision && recentAt_ > kept->first;
    LayerDocs docs = isNear ? recent_ : kept->second;
    NamespaceLog log;
    for (Revision next = (isNear ? recentAt_ : kept->first) + 1; next <= revision; ++next) {
        const Commit& commit = commits_[next - first_ - 1];
        // A layer is the same before and after its import: the one that was imported (CP2).
        if (!commit.imported)
            if (auto applied = applyCommit(docs, log, commit); !applied)
                return tl::unexpected(applied.error());
        log.prune(next);
        if (next % kKeptEvery == 0) kept_.try_emplace(next, docs);
    }
    recent_ = docs;
    recentAt_ = revision;
    forgetFarFrom(revision);
    return docs;
}

void DocTimeline::forgetFarFrom(Revision revision) {
    if (commits_.size() <= kMostCommits) return;
    const std::size_t excess = commits_.size() - kMostCommits;
    if (revision - first_ < commits_.size() / 2) {
        commits_.erase(commits_.end() - std::ptrdiff_t(excess), commits_.end());
        kept_.erase(kept_.upper_bound(last()), kept_.end());
        return;
    }
    // The newest kept contents that leave enough become the first ones.
    const auto begin = std::prev(kept_.upper_bound(first_ + excess));
    if (begin == kept_.begin()) return;
    commits_.erase(commits_.begin(), commits_.begin() + std::ptrdiff_t(begin->first - first_));
    first_ = begin->first;
    kept_.erase(kept_.begin(), begin);
}

}  // namespace usdlive::client
