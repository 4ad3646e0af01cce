// Collects the big values that a project's history names (B6).
#pragma once

#include <cstddef>
#include <unordered_map>
#include <vector>

#include "project/CommitStore.h"

namespace usdlive::server {

/// The big values that a project's history names (B6): those of its commits, and those of the
/// layers at its start, CommitStore::base(). No other record of the store names further values.
///
/// Kept in memory only: a process reads the whole log once, and afterwards only new commits. May be
/// used by any thread, but only by one at a time.
class NamedBlobs {
public:
    /// Reads the next part of the history: commits of about `mostBytes`, or one layer. Returns true
    /// if all of the history was read; otherwise call it again. Starts again if the store's history
    /// was replaced by another one. Errors: those of CommitStore::read() and layerAt().
    Result<bool> read(const CommitStore& store, std::size_t mostBytes);
    /// Returns the revision of the newest commit that was read.
    [[nodiscard]] Revision upTo() const { return upTo_; }
    /// Returns whether the history up to upTo() names the value. Precondition: the last read()
    /// returned true.
    [[nodiscard]] bool contains(const Hash& hash) const { return last_.contains(hash); }

private:
    Result<void> begin(const CommitStore& store, const CommitStore::Base& base);
    Result<void> readLayer(const CommitStore& store);
    Result<void> readCommits(const CommitStore& store, std::size_t mostBytes);
    Result<void> look(const StoredCommit& commit);
    [[nodiscard]] bool isSameHistory(const CommitStore& store) const;

    CommitStore::Base base_;
    std::vector<LayerId> layers_;  // layers whose content at the base was not read yet
    Revision upTo_ = 0;
    Hash hash_;  // chain hash at upTo_
    /// The last revision that names the value. The revision of the base stands for a layer's
    /// content there.
    std::unordered_map<Hash, Revision> last_;
};

}  // namespace usdlive::server
