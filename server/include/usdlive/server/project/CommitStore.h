// What a project needs from its store, and the records in it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// A move or delete that a commit made, kept so that addresses can be carried forward over it (M3)
/// also after the server was started again.
struct NamespaceChange {
    Revision revision = 0;
    LayerId layer;
    std::string from;
    std::optional<std::string> to;  ///< nothing: deleted
    bool operator==(const NamespaceChange&) const = default;
};

/// Moves and deletes of so many revisions are kept, whatever becomes of their commits (SE6).
inline constexpr Revision kNamespaceLogRevisions = 100'000;

/// How a file looks from outside: when that is other than it was, its content may be, too.
struct FileTrace {
    std::uint64_t size = 0, inode = 0;
    std::int64_t modifiedNs = 0, changedNs = 0;  ///< mtime and ctime, since 1970
    bool operator==(const FileTrace&) const = default;
};
/// What a file held when it was looked at.
struct FileStamp {
    FileTrace trace;
    Hash hash;  ///< SHA-256 of its bytes
    bool operator==(const FileStamp&) const = default;
};
/// A layer that is served, as the project's folder shows it.
struct LayerFile {
    LayerId layer;
    std::optional<FileTrace> trace = std::nullopt;  ///< nothing: only the store has the layer
    bool writable = true;    ///< the server's process may write it, and somebody may at all
    std::string owner = {};  ///< of the file; empty: not known
    bool operator==(const LayerFile&) const = default;
};

/// Which of a layer's states its file has.
struct SavedState {
    Revision revision = 0;          ///< 0: it was never saved
    std::optional<FileStamp> file;  ///< the file then; nothing: not known
    /// What a save is about to put in its place. After a crash between the two it tells that the
    /// file is ours.
    struct PendingSave {
        Revision revision = 0;
        Hash hash;
        bool operator==(const PendingSave&) const = default;
    };
    std::optional<PendingSave> pending = std::nullopt;
    bool operator==(const SavedState&) const = default;
};

/// A commit as it is appended.
struct CommitRecord {
    Revision revision = 0;
    TransactionId id;
    SharedBytes frame;         ///< encodeFrame(CommitFrame), with its length prefix
    Hash hash;                 ///< chain hash after it
    std::set<LayerId> layers;  ///< that it edits, or brings in
    std::vector<NamespaceChange> namespaceChanges = {};
    /// Of the layer it brought in from its file, now or anew.
    struct Saved {
        LayerId layer;
        SavedState state;
    };
    std::optional<Saved> saved = std::nullopt;
};

/// What it takes to do a commit again, about, in bytes that are read.
[[nodiscard]] inline std::size_t replayCost(std::size_t frameBytes, std::size_t edits) {
    constexpr std::size_t kCommitBytes = 256, kEditBytes = 32;
    return kCommitBytes + frameBytes + kEditBytes * edits;
}
/// How a layer was loaded: bytes of its snapshot, 0 none, and the replayCost() of what followed.
struct Replayed {
    std::size_t snapshotBytes = 0, cost = 0;
};
/// A snapshot of a layer is due when it takes so much to do its commits since the last one again:
/// about what it takes to read the layer. `lastBytes`: of the last one, 0 not known; `least`: of an
/// empty layer.
inline constexpr std::size_t kLeastReplay = 1024 * 1024;
[[nodiscard]] inline std::size_t snapshotDue(const LayerDoc& doc, std::size_t lastBytes,
                                             std::size_t least = kLeastReplay) {
    constexpr std::size_t kSpecBytes = 64;
    return least + std::max(kSpecBytes * doc.specCount(), lastBytes);
}

struct StoredCommit {
    Revision revision = 0;
    SharedBytes frame;
    Hash hash;
};

/// What the store knows of a client's transactions (M9, M14), at one moment.
struct ClientRecord {
    /// Number and revision of those it would recognize, by number: the client's last 1,024, and
    /// some that were committed late.
    std::vector<std::pair<std::uint64_t, Revision>> committed;
    Revision forgottenUpTo = 0;  ///< CommitStore::forgottenUpTo()

    [[nodiscard]] std::optional<Revision> find(std::uint64_t sequence) const {
        const auto found = std::ranges::lower_bound(committed, sequence, {},
                                                    &std::pair<std::uint64_t, Revision>::first);
        const bool isThere = found != committed.end() && found->first == sequence;
        return isThere ? std::optional(found->second) : std::nullopt;
    }
    /// The highest number, 0 none.
    [[nodiscard]] std::uint64_t last() const {
        return committed.empty() ? 0 : committed.back().first;
    }
};

/// What a store takes on its disk, in bytes.
struct StoreSpace {
    std::uint64_t log = 0;      ///< commits
    std::uint64_t clients = 0;  ///< what clients have sent (M9)
    std::uint64_t records = 0;  ///< all other records
    std::uint64_t free = 0;     ///< on the disk
    struct Layer {
        LayerId layer;
        std::uint64_t base = 0, snapshots = 0;
    };
    std::vector<Layer> layers;  ///< by name
};

/// Where a project's history is kept. What a layer holds follows from it: from a snapshot of the
/// layer and the commits since. One process has it open. Calls block; one thread calls append(),
/// any thread the others.
class CommitStore {
public:
    struct Head {
        Revision revision = 0;
        Hash hash;
        Epoch epoch = 0;  ///< the one this opening took
    };

    /// Where the history begins: commits up to this one were replaced by what each layer held then.
    struct Base {
        Revision revision = 0;  ///< 0: none was, the first commit there is is 1
        Hash hash;              ///< chain hash at the revision
        bool operator==(const Base&) const = default;
    };

    virtual ~CommitStore() = default;

    /// The newest commit that is durable.
    [[nodiscard]] virtual Head head() const = 0;
    /// Grows only, and never beyond head(). What asks for an older revision fails with
    /// HistoryReplaced.
    [[nodiscard]] virtual Base base() const = 0;

    /// Asked again and again by what takes long, which ends when it says false.
    using KeepRunning = std::function<bool()>;
    /// Replaces the commits up to `revision`, which is durable, by what each layer held then: as
    /// done again from the log, written, synced, read back and compared. After a crash at any point
    /// the base is what it was or this, and all that can be read is what it was. Beside everything
    /// else, from any thread; one call at a time; takes long. An older revision than base() does
    /// nothing. Errors: FutureRevision, StorageFull, StorageFailed, StorageCorrupt, ShuttingDown
    /// (`keepRunning` said false); nothing was replaced then.
    virtual Result<void> compact(Revision revision, const KeepRunning& keepRunning) = 0;

    /// Appends a group, all or nothing; durable when it returns (unless opened with durability
    /// `os`). Revisions contiguous from head().revision + 1. Errors: StorageFull (nothing was
    /// written; goes on when there is space again), StorageFailed (the store takes no more appends;
    /// it has to be opened anew).
    virtual Result<void> append(std::span<const CommitRecord> commits) = 0;

    /// Calls `visit` with each commit of [from, to] in order until it returns false; `from` 0 is
    /// the first there is. Checks the chain as it goes: StorageCorrupt names the revision.
    /// HistoryReplaced: `from` is not there any more.
    virtual Result<void> read(Revision from, Revision to,
                              const std::function<bool(const StoredCommit&)>& visit) const = 0;
    /// Chain hash at a revision from base() on. HistoryReplaced, FutureRevision.
    [[nodiscard]] virtual Result<Hash> hashAt(Revision revision) const = 0;

    /// Layers that commits have edited or brought in.
    [[nodiscard]] virtual Result<std::vector<LayerId>> layers() const = 0;
    /// As it stood at a revision. What was first brought in later stands as it was then, for its
    /// file was nobody's work. Nothing: no commit is for it. Errors: HistoryReplaced,
    /// StorageCorrupt, StorageFailed.
    /// `replayed`: what it was made of.
    [[nodiscard]] virtual Result<std::optional<LayerDoc>> layerAt(
        const LayerId& layer, Revision revision, Replayed* replayed = nullptr) const = 0;
    /// As of the newest commit.
    [[nodiscard]] Result<std::optional<LayerDoc>> loadLayer(const LayerId& layer,
                                                            Replayed* replayed = nullptr) const {
        return layerAt(layer, ~Revision(0), replayed);
    }
    /// Keeps what a layer holds at a revision that is durable, so that loading it does not begin at
    /// its first commit. Takes the place of what was kept of an older revision; may be lost, which
    /// costs time and nothing else. Returns its bytes. LayerNotFound: no commit is for it.
    /// HistoryDiverged: the revision's chain hash is another. StorageFull, StorageFailed.
    virtual Result<std::size_t> keepSnapshot(const LayerId& layer, const LayerDoc& doc,
                                             Revision revision, const Hash& hash) = 0;
    /// LayerNotFound for setSaved() of a layer that no commit is for.
    [[nodiscard]] virtual Result<SavedState> saved(const LayerId& layer) const = 0;
    virtual Result<void> setSaved(const LayerId& layer, const SavedState& saved) = 0;
    /// Layers that commits have changed since they were last saved.
    [[nodiscard]] virtual Result<std::vector<LayerId>> unsavedLayers() const = 0;
    /// The moves and deletes of the commits after `revision`, in order: what Project is made with.
    [[nodiscard]] virtual Result<std::vector<NamespaceChange>> namespaceChanges(
        Revision revision) const = 0;
    [[nodiscard]] virtual Result<ClientRecord> clientRecord(const ClientId& client) const = 0;
    /// Where it knows more clients than `most`, it forgets those whose last commit is the oldest:
    /// clientRecord() knows nothing of them any more. Those of `kept` stay. Beside
    /// everything else; takes long where there are many. How many it has forgotten.
    virtual Result<std::size_t> forgetClients(std::size_t most, const std::set<ClientId>& kept) = 0;
    /// No client that was forgotten has committed anything after this revision.
    [[nodiscard]] virtual Revision forgottenUpTo() const = 0;

    /// Durable when it returns. CheckpointExists; FutureRevision. One call at a time.
    virtual Result<void> addCheckpoint(const Checkpoint& checkpoint) = 0;
    /// By name.
    [[nodiscard]] virtual Result<std::vector<Checkpoint>> checkpoints() const = 0;

    /// What it takes; looks at its files.
    [[nodiscard]] virtual Result<StoreSpace> space() const = 0;
    /// Is there room for more? Cheap; asked before edits are accepted. False makes the project
    /// refuse edits with StorageFull until it is true again.
    [[nodiscard]] virtual bool hasSpace() const = 0;
};

/// Big values by content. Any thread; one thread at a time for each (hash, writer).
class BlobStore {
public:
    virtual ~BlobStore() = default;
    [[nodiscard]] virtual bool has(const Hash& hash) const = 0;
    [[nodiscard]] virtual Result<std::uint64_t> size(const Hash& hash) const = 0;
    /// Adds a part; parts of one value come in order from offset 0 (which starts anew). Uploads of
    /// one value by several writers do not see each other until one of them is whole. True when
    /// the value is whole, its hash right, and it is durable. Errors: BlobMismatch, BlobTooLarge,
    /// StorageFull, StorageFailed; the writer's parts so far are thrown away.
    virtual Result<bool> write(const Hash& hash, std::uint64_t size, std::uint64_t offset,
                               ByteView part, std::uint64_t writer = 0) = 0;
    /// Up to `count` bytes; BlobNotFound.
    [[nodiscard]] virtual Result<Bytes> read(const Hash& hash, std::uint64_t offset,
                                             std::size_t count) const = 0;

    /// The writer sends no more: its parts of values that are not whole are thrown away.
    virtual void forget(std::uint64_t writer) = 0;
    /// All values that are whole. Takes long where there are many.
    [[nodiscard]] virtual Result<std::vector<Hash>> list() const = 0;
    /// These values are not here any more: has() says so from now on, and a later upload brings one
    /// back. Returns at once; purge() frees the space.
    virtual void drop(std::span<const Hash> hashes) = 0;
    struct Purged {
        std::size_t values = 0;
        std::uint64_t bytes = 0;
    };
    /// Removes up to `most` of the values that were dropped; fewer: there are no more. What a
    /// process that was killed had dropped and not removed is whole again.
    virtual Result<Purged> purge(std::size_t most) = 0;
};

}  // namespace usdlive::server
