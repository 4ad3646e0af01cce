// The results of searches in the history.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "usdlive/common/history/Blame.h"
#include "usdlive/common/history/CommitFilter.h"
#include "usdlive/common/layer/FieldValue.h"

namespace usdlive::client {

/// Asks for a page of commits.
struct LogQuery {
    CommitFilter filter = {};  ///< its path is that at revision `before` - 1; it needs a layer
    Revision before = 0;       ///< only commits before this one; 0: all
    std::size_t limit = 100;   ///< the most commits of the page
};

/// A page of commits, the newest first.
struct LogPage {
    /// With the edits that the filter chooses; all edits if it chooses commits only. The edits of
    /// an import are not known.
    std::vector<Commit> commits;
    /// Why the page ends. More: there may be older commits that the filter chooses, also if this
    /// page has none. Base: the history begins. Since: all older ones are before the filter's time.
    enum class End { More, Base, Since } end = End::Base;
    LogQuery next;  ///< asks for the page after this one
};

/// An opinion, who has made it, and what was there before.
struct BlamedContent {
    BlamedOpinion made;
    std::optional<FieldValue> content;  ///< nothing for a spec
    bool isPriorKnown = false;          ///< `prior` was looked for
    std::optional<FieldValue> prior;    ///< nothing: there was none
};

/// The opinions of a spec.
struct BlameResult {
    Revision revision = 0;  ///< the revision of the content
    LayerDoc present;       ///< the layer at that revision
    std::vector<BlamedContent> opinions;
};

}  // namespace usdlive::client
