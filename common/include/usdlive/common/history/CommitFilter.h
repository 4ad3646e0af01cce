// Chooses commits and edits of the history.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "usdlive/common/access/OpinionKind.h"
#include "usdlive/common/history/FormerPath.h"

namespace usdlive {

/// Conditions for commits and edits. Everything that is set has to apply.
struct CommitFilter {
    std::set<UserName> users = {};  ///< their authors; empty: everybody
    std::int64_t sinceMs = std::numeric_limits<std::int64_t>::min();  ///< since 1970, inclusive
    std::int64_t untilMs = std::numeric_limits<std::int64_t>::max();  ///< since 1970, inclusive
    LayerId layer = {};                                               ///< empty: all layers
    std::string path = {};             ///< in `layer`, with everything below; empty: all of it
    std::set<OpinionKind> kinds = {};  ///< empty: all kinds
    std::string label = {};            ///< a part of their label, in any case; empty: all commits

    [[nodiscard]] bool choosesEdits() const {
        return !layer.empty() || !path.empty() || !kinds.empty();
    }
};

/// Looks for commits, the newest first, so that `path` can be followed through renames.
class CommitSearch {
public:
    /// Precondition: a filter with a path has a layer.
    explicit CommitSearch(CommitFilter filter);

    struct Found {
        /// Indexes of the edits that the filter chooses, in order; all of them if it chooses
        /// commits only.
        std::vector<std::size_t> edits;
    };
    /// Returns nothing if the filter does not choose the commit. Pass every commit: `path` is
    /// followed through all of them.
    [[nodiscard]] std::optional<Found> look(const Commit& commit);

    /// Returns the path before the oldest commit that was passed; empty: the filter has none.
    [[nodiscard]] std::string formerPath() const { return path_ ? path_->path() : std::string(); }

private:
    const CommitFilter filter_;
    std::optional<FormerPath> path_;
};

}  // namespace usdlive
