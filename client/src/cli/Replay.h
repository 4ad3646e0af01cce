// Contents of layers at other revisions, and the edits between them.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "cli/Link.h"
#include "usdlive/common/history/CommitFilter.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::cli {

struct Common;

/// A revision as people write it (`42`, `#42`), the name of a checkpoint, or `now`.
using RevisionWord = std::string;
[[nodiscard]] Result<Revision> revisionAt(Link& link, const RevisionWord& word);
/// Returns `#42`.
[[nodiscard]] std::string inRevision(Revision revision);
/// Returns the error for a revision whose commits were replaced, or that does not exist yet.
[[nodiscard]] Error isBefore(Revision base, Revision revision);
[[nodiscard]] Error isFuture(Revision revision, Revision newest);

/// Returns the filter with the target's layer.
[[nodiscard]] Result<CommitFilter> filterFor(const Link& link, const Common& options,
                                             CommitFilter filter);

/// Layers at a revision that go forward by their commits, so that their specs keep their ids:
/// difference() then finds what was renamed.
class Replay {
public:
    Replay(Link& link, LayerDocs docs, Revision revision)
        : link_(link), docs_(std::move(docs)), revision_(revision) {}

    Result<void> goTo(Revision revision);
    /// Returns the layer now with the ids of then, if it is `present`; else `present`, with the ids
    /// of `then` for the specs that have the same paths.
    [[nodiscard]] LayerDoc matched(const LayerId& layer, const LayerDoc& then,
                                   const LayerDoc& present) const;

private:
    Link& link_;
    LayerDocs docs_;
    NamespaceLog log_;
    Revision revision_;
};

/// Returns the edits that turn the content into that of `then`; with a path, only of the spec there
/// and below. `pathThen`: where it was then. `now` has the ids of `then` (Replay::matched()).
[[nodiscard]] Result<std::vector<client::AuthoredEdit>> restoring(const LayerId& layer,
                                                                  const LayerDoc& now,
                                                                  const LayerDoc& then,
                                                                  const std::string& path,
                                                                  const std::string& pathThen);
/// Returns the edits as those of a commit, to print them.
[[nodiscard]] Commit commitOf(const std::vector<client::AuthoredEdit>& edits);

}  // namespace usdlive::cli
