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

/// What follows `created` in `path`, as an Address with a creation holds it: "" for the spec
/// itself,
/// "/B.x" below a prim, "B.x" below a variant, and below a variant set "/A{v=}" what follows the
/// spec that owns it ("{v=one}B.x"). Precondition: specpath::hasPrefix(path, created).
[[nodiscard]] std::string relativePath(std::string_view path, std::string_view created);
/// The reverse: the path below `created` (whose name may be another by now; the set's name in the
/// text is passed over). Nothing when the text cannot follow such a spec.
[[nodiscard]] std::optional<std::string> absolutePath(std::string_view relative,
                                                      std::string_view created);

/// The moves and deletes of the latest revisions, which carry an address forward from the revision
/// its author had seen (M3). Bounded: entries older than what any session may refer to are
/// forgotten.
///
/// A log above another one holds what is predicted: its entries follow all entries of the log
/// below, which may grow meanwhile.
class NamespaceLog {
public:
    NamespaceLog() = default;
    /// A log above `below`, which outlives it.
    explicit NamespaceLog(const NamespaceLog* below)
        : below_(below), first_(below ? kFirstAbove : 0) {}

    /// The oldest revision addresses may be meant as of.
    [[nodiscard]] Revision oldest() const { return below_ ? below_->oldest() : oldest_; }
    void recordMove(Revision revision, const LayerId& layer, std::string from, std::string to);
    void recordDelete(Revision revision, const LayerId& layer, std::string path);

    /// Where the spec (or place) `path` of revision `since` stands now; nothing when it was
    /// deleted. Preconditions: a valid path; since >= oldest().
    [[nodiscard]] std::optional<std::string> translate(const LayerId& layer, std::string path,
                                                       Revision since) const;
    /// As translate(), from the entry with number `mark` on (see mark()).
    [[nodiscard]] std::optional<std::string> translateFrom(const LayerId& layer, std::string path,
                                                           std::uint64_t mark) const;
    /// Number of the next entry; truncate(mark) takes back what was recorded since.
    [[nodiscard]] std::uint64_t mark() const;
    void truncate(std::uint64_t mark);
    /// Forgets entries of revisions up to and including `revision`.
    void prune(Revision revision);
    /// Forgets the entries before number `mark`.
    void pruneBefore(std::uint64_t mark);

private:
    struct Entry {
        Revision revision;
        LayerId layer;
        std::string from;
        std::optional<std::string> to;  // nothing: deleted
    };
    // The numbers of the entries by what moved, for those who are many entries behind: a
    // transaction may well delete 10,000 prims one by one, and each of its edits looks at all the
    // deletes before.
    using ByPath = std::set<std::pair<std::string, std::uint64_t>>;

    // Numbers of the entries of a log above another one; the other one has lower ones.
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

/// Where the specs stand that an author's unacknowledged transactions created: one for each author.
/// An entry is kept until the author refers to a base revision that includes it.
class OwnCreations {
public:
    struct Entry {
        LayerId layer;
        std::string path;    // as committed
        std::uint64_t mark;  // of the NamespaceLog, from where on it is carried forward
    };
    OwnCreations() = default;
    /// What is not found in `below`, which outlives this, is looked for here.
    explicit OwnCreations(const OwnCreations* below) : below_(below) {}

    void record(const Creation& creation, Entry entry, Revision revision);
    [[nodiscard]] const Entry* find(const Creation& creation) const;
    [[nodiscard]] bool empty() const { return entries_.empty(); }
    /// The author has seen `revision`: creations up to it are addressed by path from now on.
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

/// The layers of a project by name. One that is not here is not loaded (execute() refuses with
/// LayerNotFound).
using LayerDocs = std::unordered_map<LayerId, LayerDoc>;

/// An executed edit with what it did, for whoever keeps the state on disk.
struct ExecutedEdit {
    Edit edit;  ///< absolute path
    LayerDoc::Applied applied;
};

struct Executed {
    std::vector<ExecutedEdit> edits;  ///< those that changed something or merged (M2)
    std::vector<DroppedEdit> dropped;
};

/// M6: why a transaction cannot be committed, and which of its edits stands in the way.
struct Refused {
    Error error;
    std::uint32_t edit = 0;
};

using Outcome = std::variant<Executed, Refused>;

/// Executes a transaction: translates its addresses (M3), drops edits of deleted specs (M4),
/// applies the rest. Nothing is changed when it is refused. The server runs it to commit; a client
/// runs the very same on its confirmed layers to predict what its pending transactions will become
/// (M7).
///
/// `revision` is the one the commit will have. Refusals: StaleBase, FutureRevision (base >
/// revision-1), LayerNotFound, SpecKindConflict, SpecExists, MoveIntoItself, InvalidPath,
/// InvalidEdit, InvalidValue, ForbiddenValue. Drops: SpecDeleted (also: created by a transaction
/// that was refused, so that `creation` is unknown), SpecNotFound, SpecKindConflict (ED7). Also of
/// a Create whose parent, and a Move whose spec or new parent is gone.
///
/// When it is executed, the moves and deletes are recorded in `log`, and what the transaction
/// created in `creations`; there is no need of recordCreations() then. Forgetting is the caller's:
/// a transaction that is sent anew may have a later base than those that still refer to creations.
[[nodiscard]] Outcome execute(LayerDocs& layers, NamespaceLog& log, OwnCreations& creations,
                              const Transaction& transaction, Revision revision);

/// Executes edits whose paths are absolute, each valid after the ones before, as difference() gives
/// them. Nothing is changed on an error, which is that of LayerDoc::apply(), or LayerNotFound.
[[nodiscard]] Result<Executed> executeInOrder(LayerDocs& layers, NamespaceLog& log,
                                              std::vector<Edit> edits, Revision revision);

/// Applies what the server committed to the confirmed layers and records its moves and deletes.
/// Layers that are not in `layers` are passed over. An error means the replica has diverged: the
/// layer named in it has to be joined again; the others have got all that is theirs.
Result<void> applyCommit(LayerDocs& layers, NamespaceLog& log, const Commit& commit);

/// For the author's own commit: notes where the specs stand that `submitted` created. The commit
/// holds one edit for each submitted one that was not dropped, in the same order. Call it with the
/// log as it is right after applyCommit(); moves of the commit itself are minded.
void recordCreations(OwnCreations& creations, NamespaceLog& log, const Transaction& submitted,
                     const Commit& commit);

}  // namespace usdlive
