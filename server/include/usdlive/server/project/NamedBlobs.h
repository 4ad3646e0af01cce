// Which big values the history names (B6).
#pragma once

#include <cstddef>
#include <unordered_map>
#include <vector>

#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// The big values that a project's history names (B6): its commits, and the layers as they stood
/// where it begins. Everything else in the store (snapshots, checkpoints) follows from these.
///
/// In memory only: a process reads the whole log once, and later only what was added. One thread at
/// a time.
class NamedBlobs {
public:
    /// Reads the next part of the history: commits of about `mostBytes`, or one layer. True when it
    /// has read everything.
    Result<bool> read(const CommitStore& store, std::size_t mostBytes);
    /// Of the newest commit that was read.
    [[nodiscard]] Revision upTo() const { return upTo_; }
    /// Does the history name it? Precondition: read() was true.
    [[nodiscard]] bool contains(const Hash& hash) const { return last_.contains(hash); }

private:
    Result<void> begin(const CommitStore& store, const CommitStore::Base& base);
    Result<void> readLayer(const CommitStore& store);
    Result<void> readCommits(const CommitStore& store, std::size_t mostBytes);
    Result<void> look(const StoredCommit& commit);
    [[nodiscard]] bool isSameHistory(const CommitStore& store) const;

    CommitStore::Base base_;
    std::vector<LayerId> layers_;  // whose values at the base are not read yet
    Revision upTo_ = 0;
    Hash hash_;  // chain hash at upTo_
    /// By which commit it was named last; the base's revision: also by a layer as it stood then.
    std::unordered_map<Hash, Revision> last_;
};

}  // namespace usdlive::server
