// The oldest revision that can be read.
#pragma once

#include <algorithm>
#include <optional>

#include "usdlive/server/project/CommitContent.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// The start of the history (CH4). While older commits are being replaced by a base, the oldest
/// revision that may be asked for is later than the base that there is.
class HistoryStart {
public:
    explicit HistoryStart(const CommitStore::Base& base) : base_(base), oldest_(base.revision) {}

    [[nodiscard]] const CommitStore::Base& base() const { return base_; }
    /// Nobody may ask for what is older.
    [[nodiscard]] Revision oldest() const { return oldest_; }
    /// Why a layer as of this revision cannot be read.
    [[nodiscard]] std::optional<Error> whyNotReadable(Revision revision) const {
        if (revision >= oldest_) return std::nullopt;
        return historyReplaced(revision, oldest_).value();
    }

    /// The commits up to `revision` are being replaced.
    void replacing(Revision revision) { oldest_ = revision; }
    void replacingEnded() { oldest_ = base_.revision; }
    /// The base is this now. It only grows.
    void moveTo(const CommitStore::Base& base) {
        if (base.revision > base_.revision) base_ = base;
        oldest_ = std::max(oldest_, base_.revision);
    }

private:
    CommitStore::Base base_;
    Revision oldest_;
};

}  // namespace usdlive::server
