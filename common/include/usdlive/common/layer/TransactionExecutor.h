// Executes transactions, on the server and for predictions of clients.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <variant>
#include <vector>

#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// Returns the part of `path` after `created`, in the form of an Address with a creation: "" for
/// the spec itself, "/B.x" below a prim, "B.x" below a variant. Below a variant set "/A{v=}" it is
/// the part after the owner of the set ("{v=one}B.x"). Precondition: specpath::hasPrefix(path,
/// created).
[[nodiscard]] std::string relativePath(std::string_view path, std::string_view created);
/// Returns the path of `relative` below `created`. `created` may have been renamed since: the name
/// of the set in `relative` is ignored. Returns nothing if such a spec cannot have this child.
[[nodiscard]] std::optional<std::string> absolutePath(std::string_view relative,
                                                      std::string_view created);

/// The moves and deletes of the latest revisions. They translate an address from the revision that
/// its author has seen to the current one (M3). Bounded: prune() removes entries older than any
/// revision that a session may refer to.
///
/// A log above another one holds predictions: its entries follow all entries of the log below,
/// which may still grow.
class NamespaceLog {
public:
    NamespaceLog() = default;
    /// A log above `below`, which must outlive it.
    explicit NamespaceLog(const NamespaceLog* below)
        : below_(below), first_(below ? kFirstAbove : 0) {}

    /// The oldest revision that addresses may refer to.
    [[nodiscard]] Revision oldest() const { return below_ ? below_->oldest() : oldest_; }
    void recordMove(Revision revision, const LayerId& layer, std::string from, std::string to);
    void recordDelete(Revision revision, const LayerId& layer, std::string path);

    /// Returns the current path of the spec (or place) `path` of revision `since`, or nothing if it
    /// was deleted. Preconditions: a valid path; since >= oldest().
    [[nodiscard]] std::optional<std::string> translate(const LayerId& layer, std::string path,
                                                       Revision since) const;
    /// Translates like translate(), from entry number `mark` on (see mark()).
    [[nodiscard]] std::optional<std::string> translateFrom(const LayerId& layer, std::string path,
                                                           std::uint64_t mark) const;
    /// Returns the number of the next entry. truncate(mark) removes all entries from that number
    /// on.
    [[nodiscard]] std::uint64_t mark() const;
    void truncate(std::uint64_t mark);
    /// Removes the entries of revisions up to and including `revision`.
    void prune(Revision revision);
    /// Removes the entries before number `mark`.
    void pruneBefore(std::uint64_t mark);

private:
    struct Entry {
        Revision revision;
        LayerId layer;
        std::string from;
        std::optional<std::string> to;  // nothing: deleted
    };
    // Indexes the entries by the moved path, for translations over many entries: a transaction may
    // delete 10,000 prims one by one, and each of its edits looks at all deletes before.
    using ByPath = std::set<std::pair<std::string, std::uint64_t>>;

    // A log above another one numbers its entries from here on, after those of the other.
    static constexpr std::uint64_t kFirstAbove = std::uint64_t(1) << 62;

    void record(Entry entry);
    void forgetFirst();
    void dropFromIndex(std::uint64_t number, const Entry& entry);
    [[nodiscard]] std::optional<std::uint64_t> firstConcerning(const LayerId& layer,
                                                               std::string_view path,
                                                               std::uint64_t mark) const;

    const NamespaceLog* below_ = nullptr;
    std::deque<Entry> entries_;
    std::unordered_map<LayerId, ByPath> byPath_;
    std::uint64_t first_ = 0;  // number of entries_.front()
    Revision oldest_ = 0;
};

/// The current paths of the specs that an author's unacknowledged transactions created; one object
/// per author. An entry is kept until the author refers to a base revision that includes it.
class OwnCreations {
public:
    struct Entry {
        LayerId layer;
        std::string path;    // the path in the commit
        std::uint64_t mark;  // entry number of the NamespaceLog from which the path is translated
    };
    OwnCreations() = default;
    /// Looks in `below` first, which must outlive this object.
    explicit OwnCreations(const OwnCreations* below) : below_(below) {}

    void record(const Creation& creation, Entry entry, Revision revision);
    [[nodiscard]] const Entry* find(const Creation& creation) const;
    [[nodiscard]] bool empty() const { return entries_.empty(); }
    /// Call when the author has seen `revision`. Creations up to it are from then on addressed by
    /// path.
    void seen(Revision revision);
    void forget(std::uint64_t sequence);

private:
    struct Kept {
        Entry entry;
        Revision revision;
    };
    const OwnCreations* below_ = nullptr;
    std::map<Creation, Kept> entries_;
};

/// The loaded layers of a project by name. execute() refuses an edit of another layer with
/// LayerNotFound.
using LayerDocs = std::unordered_map<LayerId, LayerDoc>;

/// An executed edit and its result, for owners of stored state.
struct ExecutedEdit {
    Edit edit;  ///< absolute path
    LayerDoc::Applied applied;
};

struct Executed {
    std::vector<ExecutedEdit> edits;  ///< those that changed something or merged (M2)
    std::vector<DroppedEdit> dropped;
};

/// M6: the reason why a transaction cannot be committed, and the edit that causes it.
struct Refused {
    Error error;
    std::uint32_t edit = 0;
};

using Outcome = std::variant<Executed, Refused>;

/// Executes a transaction: translates its addresses (M3), drops edits of deleted specs (M4) and
/// applies the rest. A refused transaction changes nothing. The server runs this function to
/// commit. A client runs the same function on its confirmed layers to predict its pending
/// transactions (M7).
///
/// `revision` is the number of the new commit. Refusals: StaleBase, FutureRevision (base >
/// revision-1), LayerNotFound, SpecKindConflict, SpecExists, MoveIntoItself, InvalidPath,
/// InvalidEdit, InvalidValue, ForbiddenValue. Reasons of dropped edits: SpecDeleted (also if
/// `creation` is unknown because its transaction was refused), SpecNotFound, SpecKindConflict
/// (ED7). They also apply to a Create whose parent was deleted, and to a Move whose spec or new
/// parent was deleted.
///
/// Success records the moves and deletes in `log` and the created specs in `creations`; do not call
/// recordCreations() then. The caller removes old entries, because a transaction that is sent again
/// may have a later base than others that still refer to creations.
[[nodiscard]] Outcome execute(LayerDocs& layers, NamespaceLog& log, OwnCreations& creations,
                              const Transaction& transaction, Revision revision);

/// Executes edits with absolute paths, each valid after the ones before, as difference() returns
/// them. An error changes nothing: LayerNotFound, or an error of LayerDoc::apply().
[[nodiscard]] Result<Executed> executeInOrder(LayerDocs& layers, NamespaceLog& log,
                                              std::vector<Edit> edits, Revision revision);

/// Applies a commit of the server to the confirmed layers and records its moves and deletes.
/// Ignores layers that are not in `layers`. An error means that the replica has diverged: join the
/// layer that it names again. All other layers have received their edits.
Result<void> applyCommit(LayerDocs& layers, NamespaceLog& log, const Commit& commit);

/// Records the paths of the specs that the author's own transaction `submitted` created. The commit
/// holds one edit for each submitted one that was not dropped, in the same order. Call it directly
/// after applyCommit(); it takes the moves of the commit itself into account.
void recordCreations(OwnCreations& creations, NamespaceLog& log, const Transaction& submitted,
                     const Commit& commit);

}  // namespace usdlive
