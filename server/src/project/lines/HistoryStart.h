// The start of the history: the oldest revision that can be read.
#pragma once

#include <algorithm>
#include <optional>

#include "project/CommitContent.h"
#include "project/CommitStore.h"

namespace usdlive::server {

/// The start of the history (CH4). While commits are being replaced by a base, requests must
/// already be newer than that base.
class HistoryStart {
public:
    explicit HistoryStart(const CommitStore::Base& base) : base_(base), oldest_(base.revision) {}

    [[nodiscard]] const CommitStore::Base& base() const { return base_; }
    /// Returns the oldest revision that may be requested.
    [[nodiscard]] Revision oldest() const { return oldest_; }
    /// Returns the error if a layer cannot be read at this revision.
    [[nodiscard]] std::optional<Error> whyNotReadable(Revision revision) const {
        if (revision >= oldest_) return std::nullopt;
        return historyReplaced(revision, oldest_).value();
    }

    /// Call it when the replacement of the commits up to `revision` begins.
    void replacing(Revision revision) { oldest_ = revision; }
    void replacingEnded() { oldest_ = base_.revision; }
    /// Changes the base. It only grows.
    void moveTo(const CommitStore::Base& base) {
        if (base.revision > base_.revision) base_ = base;
        oldest_ = std::max(oldest_, base_.revision);
    }

private:
    CommitStore::Base base_;
    Revision oldest_;
};

}  // namespace usdlive::server
