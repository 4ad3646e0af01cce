// Brings what one line of history has changed to another one.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/client/session/Events.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// Something that both lines have changed since they parted, and not in the same way.
struct MergeConflict {
    enum class What {
        Value,    ///< both have written the register
        Deleted,  ///< one has deleted a spec that the other has changed, or something below it
        Moved,    ///< both have renamed or moved the spec
        /// The change is not possible in the other line, for the `reason`: it has another spec at
        /// that place, for example. From is an error here.
        Refused
    };
    What what = What::Value;
    LayerId layer;
    /// The spec's path in the line that is merged; if it is deleted there, the one before.
    std::string path;
    std::string field;  ///< empty: the spec itself
    FieldPart part = {};
    /// The register's contents when the lines parted, and now in each; nothing: absent.
    std::optional<FieldValue> before = {}, into = {}, from = {};
    bool isDeletedFrom = false;  ///< the line that is merged has deleted the spec
    std::string reason = {};
    UserName intoUser, fromUser;  ///< the last users who have changed the spec in each line
};

/// Which line's change counts.
enum class Side { Undecided, Into, From };

/// Makes the edits that bring the changes of one line (`from`) to another one (`into`). Both begin
/// with the same layers at the same revision. Changes are carried through what the other line has
/// renamed, moved and deleted since, as the server carries an edit of an earlier revision (M3).
///
/// Add the commits of both lines in order, then call merge(), any number of times. Where one line
/// has received what the other one had, by a merge in either direction, call received(): what was
/// known to both is common from then on. One thread.
class LineMerge {
public:
    /// `common`: the layers when the lines parted, at `revision`. A layer that only one line uses
    /// is there as it was when that line began to use it. Edits of other layers are ignored.
    LineMerge(LayerDocs common, Revision revision);

    /// Error: one of LayerDoc::apply(), if the commit does not follow those before.
    Result<void> addFrom(const Commit& commit) { return from_.add(commit); }
    Result<void> addInto(const Commit& commit) { return into_.add(commit); }
    /// Replaces what a line (From or Into) has in a layer now, if its commits do not tell it: it
    /// began to use the layer with another content, for example. Specs are found again by their
    /// paths. Error: one of LayerDoc::apply().
    Result<void> setContent(Side line, const LayerId& layer, const LayerDoc& content);
    /// Call it before merge() if setContent() was called and commits were added since. In a layer
    /// that did not begin with the common content, a spec of Into is the common one that is or was
    /// at its place, unless Into has that one elsewhere. Error: one of LayerDoc::apply().
    Result<void> matchContents();
    /// The line `receiver` (From or Into) has received all that the other one has now: the commits
    /// added last to both are the merge and the newest that it has merged. What the other line has
    /// is common from now on; what the receiver has beside it counts as its own change. Error: one
    /// of LayerDoc::apply().
    Result<void> received(Side receiver);

    [[nodiscard]] const LayerDocs& into() const { return into_.docs; }
    [[nodiscard]] const LayerDocs& from() const { return from_.docs; }
    /// Returns the layers that the merged line has changed.
    [[nodiscard]] std::vector<LayerId> changed() const;

    struct Merged {
        std::vector<AuthoredEdit> edits;       ///< in an order in which they apply to into()
        std::vector<MergeConflict> conflicts;  ///< all of them, with the decision for each
        std::vector<Side> decisions;
        /// The number of further edits that are left out, because the other line lacks their specs.
        std::size_t dropped = 0;
    };
    /// `decide` is called once for each conflict. What is undecided counts as Into. Error:
    /// InvalidArgument if From was decided for a change that the other line refuses.
    [[nodiscard]] Result<Merged> merge(
        const std::function<Side(const MergeConflict&)>& decide) const;

private:
    // A line since the lines parted.
    struct Line {
        LayerDocs docs;
        NamespaceLog log;
        Revision revision;
        std::map<std::pair<LayerId, NodeId>, UserName> users;  // the last ones who changed a spec
        std::set<LayerId> apart;  // layers that did not begin with the common content

        Result<void> add(const Commit& commit);
        /// Changes a layer to a content, whose ids are those of the layer for the same specs.
        Result<void> change(const LayerId& layer, const LayerDoc& content);
        /// Begins again with `base`, and changes the layers to their contents.
        Result<void> rebuild(const LayerDocs& base, const LayerDocs& contents);
    };
    class Comparison;

    LayerDocs common_;
    Revision revision_;  // that of into_ when the lines parted
    Line from_, into_;
};

}  // namespace usdlive::client
