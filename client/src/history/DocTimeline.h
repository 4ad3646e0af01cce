// Layers at each revision of a part of the history.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// Layers at the revisions of a part of the history: their contents at its first revision, and the
/// commits since. Contents of later revisions are made of these, and some are kept: a step back
/// costs at most kKeptEvery commits, and one forward costs one. All contents share structure and
/// the ids of their specs, so that difference() of two of them costs in proportion to what has
/// changed.
///
/// Bounded: at most about kMostCommits, those that are farthest from the revision that was asked
/// for last are forgotten.
class DocTimeline {
public:
    static constexpr std::size_t kMostCommits = 8'192;
    static constexpr std::size_t kKeptEvery = 32;

    /// Forgets everything. `docs`: the layers at `revision`.
    void start(LayerDocs docs, Revision revision);
    /// Adds the commits after last(), in order.
    void add(std::vector<Commit> commits);
    [[nodiscard]] Revision first() const { return first_; }
    [[nodiscard]] Revision last() const { return first_ + commits_.size(); }
    [[nodiscard]] bool contains(Revision revision) const {
        return revision >= first_ && revision <= last();
    }
    /// Returns the layers at a revision. Error: a commit does not fit. Precondition: contains().
    [[nodiscard]] Result<LayerDocs> at(Revision revision);
    /// Returns the time of a commit, in milliseconds since 1970. Precondition: it is after first().
    [[nodiscard]] std::int64_t timeOf(Revision revision) const {
        return commits_[revision - first_ - 1].timeMs;
    }
    /// Returns the commits after first().
    [[nodiscard]] std::vector<Commit> commits() const { return {commits_.begin(), commits_.end()}; }

private:
    void forgetFarFrom(Revision revision);

    Revision first_ = 0;
    std::deque<Commit> commits_;          // those after first_
    std::map<Revision, LayerDocs> kept_;  // at first_ and some later revisions
    Revision recentAt_ = 0;               // at() was called with it last
    LayerDocs recent_;
};

}  // namespace usdlive::client
