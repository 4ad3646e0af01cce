// Executes transactions, on the server and for predictions of clients.
#pragma once

#include <algorithm>
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

/// The moves and deletes of the latest revisions. They translate an address from the revision that
/// its author has seen to the current one (M3). Bounded: prune() removes entries older than any
/// revision that a session may refer to. It also notes which fields the latest revisions gave paths
/// (M16).
///
/// An entry is of a spec, or of a place (M15): the author moved or deleted the object of a stage
/// there. Both carry specs and what values name. A spec that is to be created follows the entries
/// of its parent, and of its own place only those of places: an earlier spec there was another one.
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
    enum class Of { Spec, Place };
    /// A number for a client; 0 is none.
    using Author = std::size_t;
    [[nodiscard]] static Author authorOf(const ClientId& client) {
        return std::hash<std::string>()(client.value);
    }
    void recordMove(Revision revision, const LayerId& layer, std::string from, std::string to,
                    Of what = Of::Spec, Author author = 0);
    void recordDelete(Revision revision, const LayerId& layer, std::string path, Of what = Of::Spec,
                      Author author = 0);

    /// Returns the current path of the spec (or place) `path` of revision `since`, or nothing if it
    /// was deleted. Preconditions: a valid path; since >= oldest().
    [[nodiscard]] std::optional<std::string> translate(const LayerId& layer, std::string path,
                                                       Revision since) const;
    /// Translates like translate(), from entry number `mark` on (see mark()).
    [[nodiscard]] std::optional<std::string> translateFrom(const LayerId& layer, std::string path,
                                                           std::uint64_t mark) const;
    /// Returns the current path of a place at which a spec is to be created, or nothing if the
    /// author of an entry has deleted it. `mark` as in translateFrom().
    [[nodiscard]] std::optional<std::string> translatePlace(const LayerId& layer, std::string path,
                                                            std::uint64_t mark) const;
    /// Returns the current path of a place whose object was deleted: deletes leave the place where
    /// it is. `mark` as in translateFrom().
    [[nodiscard]] std::string translateVacated(const LayerId& layer, std::string path,
                                               std::uint64_t mark) const;
    /// Does the same as translatePlace() with the entries of places that authors other than
    /// `author` made, from number `mark` up to number `end`.
    [[nodiscard]] std::optional<std::string> translatePlaceBetween(const LayerId& layer,
                                                                   std::string path,
                                                                   std::uint64_t mark,
                                                                   std::uint64_t end,
                                                                   Author author) const;
    /// A place and what is above it, where translatePlaceBetween() puts them; nothing: deleted.
    struct Followed {
        std::optional<std::string> place, above;
        /// If an entry has moved the place and not what is above it: the number after that entry.
        /// The paths are those after it, later entries are not followed.
        std::optional<std::uint64_t> left = {};
    };
    [[nodiscard]] Followed followPlace(const LayerId& layer, std::string place, std::string above,
                                       std::uint64_t mark, std::uint64_t end, Author author) const;
    /// Returns the number of the next entry. truncate(mark) removes all entries from that number
    /// on.
    [[nodiscard]] std::uint64_t mark() const;
    /// Returns the number after the last entry of a place, or 0.
    [[nodiscard]] std::uint64_t lastPlace() const { return lastPlace_; }
    /// Returns the number of the first entry after `revision`.
    [[nodiscard]] std::uint64_t markAfter(Revision revision) const;
    void truncate(std::uint64_t mark);
    /// Removes the entries of revisions up to and including `revision`.
    void prune(Revision revision);
    /// Removes the entries before number `mark`.
    void pruneBefore(std::uint64_t mark);

    /// Notes that a revision gave the field of a spec paths. A log above another one notes nothing:
    /// its author has seen what it predicts.
    void recordNaming(Revision revision, const LayerId& layer, const std::string& path,
                      std::string_view field, Author author);
    /// Returns whether the entry with this number is the move or delete of an executed edit.
    [[nodiscard]] bool isEntry(std::uint64_t number, const Edit& executed) const;
    /// Call it if fields that got paths up to `revision` may not have been noted.
    void forgetNamings(Revision revision) { namingsSince_ = std::max(namingsSince_, revision); }
    /// Calls `visit` with the current path of each spec in the layer, and with the field, to which
    /// authors other than `author` gave paths after revision `since`. Returns false if not all of
    /// them are known any more.
    bool forEachNaming(
        const LayerId& layer, Revision since, Author author,
        const std::function<void(std::string path, const std::string& field)>& visit) const;

private:
    struct Entry {
        Revision revision;
        LayerId layer;
        std::string from;
        std::optional<std::string> to;  // nothing: deleted
        Of what;
        Author author;
    };
    struct Naming {
        Revision revision;
        LayerId layer;
        std::string path, field;
        std::uint64_t mark;  // the path is that before the entry with this number
        Author author;
    };
    // Which entries a translation follows.
    enum class Follow { All, ForPlace, Vacated, OthersPlaces };
    // Indexes the entries by the moved path, for translations over many entries: a transaction may
    // delete 10,000 prims one by one, and each of its edits looks at all deletes before.
    using ByPath = std::set<std::pair<std::string, std::uint64_t>>;

    // A log above another one numbers its entries from here on, after those of the other.
    static constexpr std::uint64_t kFirstAbove = std::uint64_t(1) << 62;

    void record(Entry entry);
    [[nodiscard]] std::optional<std::string> walk(const LayerId& layer, std::string path,
                                                  std::uint64_t mark, std::uint64_t end,
                                                  Follow follow, Author author = 0) const;
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
    std::uint64_t lastPlace_ = 0;
    std::deque<Naming> namings_;
    Revision namingsSince_ = 0;  // all after this one are known
};

/// A place at an earlier moment: the path that it had before entry number `mark` of the
/// NamespaceLog.
struct PlaceBefore {
    std::string path;
    std::uint64_t mark = 0;
};

/// The current paths of the specs that an author's unacknowledged transactions created, and of the
/// places from which they moved or deleted objects (M15); one object per author. An entry is kept
/// until the author refers to a base revision that includes it.
class OwnCreations {
public:
    struct Entry {
        LayerId layer;
        std::string path;    // the path in the commit; for an edit of a place, the vacated one
        std::uint64_t mark;  // entry number of the NamespaceLog from which the path is translated
        /// The created spec's place as its author saw it; nothing if it is unknown, and for a place
        /// that an edit of the author has vacated.
        std::optional<PlaceBefore> place = {};
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
    /// The author's own values of the fields that were merged with those of somebody else's spec
    /// (M13), by the number of the edit in `edits`.
    std::map<std::size_t, FieldValue> unmerged;
};

/// M6: the reason why a transaction cannot be committed, and the edit that causes it.
struct Refused {
    Error error;
    std::uint32_t edit = 0;
};

using Outcome = std::variant<Executed, Refused>;

/// Records the move or delete of an executed edit, if it is one.
void recordMove(NamespaceLog& log, Revision revision, const ClientId& author, const Edit& executed);

/// Executes a transaction: translates its addresses (M3) and the paths in its values (M15), drops
/// edits of deleted specs (M4), applies the rest, and corrects paths that its author had not seen
/// (M16). A refused transaction changes nothing. The server runs this function to
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

/// Sees each edit of a commit before and after it is applied to its layer.
class AppliedEdits {
public:
    virtual ~AppliedEdits() = default;
    virtual void before(const LayerDoc& doc, const Edit& edit) = 0;
    virtual void after(const LayerDoc& doc, const Edit& edit) = 0;
};

/// Applies a commit of the server to the confirmed layers and records its moves and deletes.
/// Ignores layers that are not in `layers`. An error means that the replica has diverged: join the
/// layer that it names again. All other layers have received their edits. `observer` may be null.
Result<void> applyCommit(LayerDocs& layers, NamespaceLog& log, const Commit& commit,
                         AppliedEdits* observer = nullptr);

/// Calls `visit` for each edit of a commit that is the newest in `log`, with its index in the
/// transaction and the mark of the log after it. The log lacks the moves in unknown layers.
void forEachExecuted(
    const NamespaceLog& log, const Commit& commit,
    const std::function<void(const Edit& edit, std::uint32_t index, std::uint64_t mark)>& visit);

/// Returns the specs that a commit created and the places that it vacated, by the index of the edit
/// in the transaction, as forEachExecuted() finds them. The places of the entries are unknown.
[[nodiscard]] std::map<std::uint32_t, OwnCreations::Entry> createdBy(const NamespaceLog& log,
                                                                     const Commit& commit);

/// Records the paths of the specs that the author's own transaction `submitted` created, and the
/// places that it vacated. The commit holds one edit for each submitted one that was not dropped,
/// in the same order. Call it directly after applyCommit().
void recordCreations(OwnCreations& creations, const NamespaceLog& log, const Transaction& submitted,
                     const Commit& commit);

}  // namespace usdlive
