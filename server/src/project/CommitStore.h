// The interfaces of a project's stores, CommitStore and BlobStore, and the records that they hold.
//
// A new kind of store (for example over a database server) implements these two interfaces and
// passes the suites CommitStoreContractTest and BlobStoreContractTest in tests/contract.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
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

/// A move or delete of a spec, or of what is at a place (M15), that a commit made. The store keeps
/// it so that addresses can be carried forward over it (M3), also after the server was restarted.
struct NamespaceChange {
    Revision revision = 0;
    LayerId layer;
    std::string from;               ///< the spec's path before the commit
    std::optional<std::string> to;  ///< the path after it; nothing: the spec was deleted
    bool place = false;
    bool operator==(const NamespaceChange&) const = default;
};

/// The store keeps the moves and deletes of the last kNamespaceLogRevisions revisions, also when
/// their commits were replaced by a base (SE6).
inline constexpr Revision kNamespaceLogRevisions = 100'000;

/// The metadata of a file. A changed FileTrace means that the content may have changed.
struct FileTrace {
    std::uint64_t size = 0, inode = 0;           ///< size in bytes
    std::int64_t modifiedNs = 0, changedNs = 0;  ///< mtime and ctime, nanoseconds since 1970
    bool operator==(const FileTrace&) const = default;
};
/// The metadata and content hash of a file at the time when it was read.
struct FileStamp {
    FileTrace trace;
    Hash hash;  ///< SHA-256 of its bytes
    bool operator==(const FileStamp&) const = default;
};
/// A served layer and its file in the project's folder.
struct LayerFile {
    LayerId layer;
    std::optional<FileTrace> trace = std::nullopt;  ///< nothing: only the store has the layer
    bool writable = true;    ///< false: read-only, or the server's process may not write it
    std::string owner = {};  ///< user name of the file's owner; empty: unknown
    bool operator==(const LayerFile&) const = default;
};

/// The state of a layer that its file contains.
struct SavedState {
    Revision revision = 0;          ///< revision of the last save; 0: the layer was never saved
    std::optional<FileStamp> file;  ///< the file after that save; nothing: unknown
    /// The file that a save is about to write. It is stored before the file is replaced: if the
    /// server crashes in between, the hash identifies the new file as the server's own.
    struct PendingSave {
        Revision revision = 0;
        Hash hash;
        bool operator==(const PendingSave&) const = default;
    };
    std::optional<PendingSave> pending = std::nullopt;
    bool operator==(const SavedState&) const = default;
};

/// A commit, as it is passed to CommitStore::append().
struct CommitRecord {
    Revision revision = 0;     ///< counts from 1
    TransactionId id;          ///< the author's client and its number; an empty client: none
    SharedBytes frame;         ///< encodeFrame(CommitFrame), with its length prefix; never null
    Hash hash;                 ///< hash of the chain up to and including this commit
    std::set<LayerId> layers;  ///< layers that the commit edits or imports
    std::vector<NamespaceChange> namespaceChanges = {};
    /// The new SavedState of a layer that the commit imports or reloads from its file. The store
    /// writes it in the same atomic step as the commit.
    struct Saved {
        LayerId layer;
        SavedState state;
    };
    std::optional<Saved> saved = std::nullopt;
};

/// Returns the estimated cost of executing a stored commit again, in bytes that have to be read.
[[nodiscard]] inline std::size_t replayCost(std::size_t frameBytes, std::size_t edits) {
    constexpr std::size_t kCommitBytes = 256, kEditBytes = 32;
    return kCommitBytes + frameBytes + kEditBytes * edits;
}
/// The cost of loading a layer.
struct Replayed {
    std::size_t snapshotBytes = 0;  ///< size of the snapshot or base; 0: none was read
    std::size_t cost = 0;           ///< replayCost() of the commits that were executed after it
};
/// Returns the replayCost() at which a layer needs a new snapshot: about the cost of reading the
/// layer itself. `lastBytes` is the size of the last snapshot (0: unknown), `least` the result for
/// an empty layer.
inline constexpr std::size_t kLeastReplay = 1024 * 1024;
[[nodiscard]] inline std::size_t snapshotDue(const LayerDoc& doc, std::size_t lastBytes,
                                             std::size_t least = kLeastReplay) {
    constexpr std::size_t kSpecBytes = 64;
    return least + std::max(kSpecBytes * doc.specCount(), lastBytes);
}

/// A commit, as it is read from the store.
struct StoredCommit {
    Revision revision = 0;
    SharedBytes frame;  ///< the bytes of CommitRecord::frame
    Hash hash;          ///< hash of the chain up to and including this commit
};

/// A client's committed transactions, as far as the store remembers them (M9, M14).
struct ClientRecord {
    /// Number and revision of each remembered transaction, sorted by number: the 1,024 highest
    /// numbers, and lower ones that were committed late.
    std::vector<std::pair<std::uint64_t, Revision>> committed;
    Revision forgottenUpTo = 0;  ///< CommitStore::forgottenUpTo() at the time of the read

    /// Returns the revision of the transaction with this number; nothing if it is not remembered.
    [[nodiscard]] std::optional<Revision> find(std::uint64_t sequence) const {
        const auto found = std::ranges::lower_bound(committed, sequence, {},
                                                    &std::pair<std::uint64_t, Revision>::first);
        const bool isThere = found != committed.end() && found->first == sequence;
        return isThere ? std::optional(found->second) : std::nullopt;
    }
    /// Returns the highest number; 0: none.
    [[nodiscard]] std::uint64_t last() const {
        return committed.empty() ? 0 : committed.back().first;
    }
};

/// The disk space that a store uses, in bytes.
struct StoreSpace {
    std::uint64_t log = 0;      ///< the commits
    std::uint64_t clients = 0;  ///< the transactions of clients (M9)
    std::uint64_t records = 0;  ///< all other records
    std::uint64_t free = 0;     ///< free space on the disk
    struct Layer {
        LayerId layer;
        std::uint64_t base = 0, snapshots = 0;
    };
    std::vector<Layer> layers;  ///< sorted by name
};

/// Names the content of a layer: two equal versions of a layer have the same content.
struct LayerVersion {
    Revision revision = 0;
    Hash hash;  ///< chain hash at the revision
    bool operator==(const LayerVersion&) const = default;
};

/// The durable history of one project: a log of commits, and records that belong to it.
///
/// Revisions count from 1 without gaps. The content of a layer is the result of its commits in
/// order; snapshots and bases only make it faster to read. Only one process may have a store open.
///
/// **Threads.** All functions block. append() is called by one thread. All other functions are
/// called by any thread, also during append() and compact(), unless their comment says otherwise.
/// **Errors.** Every function that returns a Result can fail with StorageFailed (the storage does
/// not work) or StorageCorrupt (stored data is damaged; the message names the record). A comment
/// names the further errors. Functions without a Result are cheap.
class CommitStore {
public:
    struct Head {
        Revision revision = 0;  ///< 0: no commit yet
        Hash hash;              ///< hash of the chain up to and including the revision
        Epoch epoch = 0;  ///< grows with each opening of the store, which stores it durably first
    };

    /// The start of the history. The commits up to `revision` no longer exist; the store has the
    /// content of each layer at this revision instead (its base).
    struct Base {
        Revision revision = 0;  ///< 0: all commits exist
        Hash hash;              ///< hash of the chain up to and including the revision
        bool operator==(const Base&) const = default;
    };

    virtual ~CommitStore() = default;

    /// Returns the identity of the store (ID1). It is made with the store and never changes; a
    /// store of an earlier version gets one when it is opened.
    [[nodiscard]] virtual StoreId identity() const = 0;
    /// Returns the newest durable commit.
    [[nodiscard]] virtual Head head() const = 0;
    /// Returns the start of the history. It only grows, and never exceeds head(). A request for an
    /// older revision fails with HistoryReplaced.
    [[nodiscard]] virtual Base base() const = 0;

    /// Asked repeatedly by a long operation. If it returns false, the operation stops.
    using KeepRunning = std::function<bool()>;
    /// Moves base() to `revision`: replaces the commits up to it by the content of each layer.
    /// Reads and verifies these commits first, and compares the written content with them before it
    /// removes any commit.
    ///
    /// After a crash at any point, base() is the old or the new one, and everything from base() on
    /// can be read. Takes long and runs beside all other functions, from any thread; one call at a
    /// time. Does nothing if `revision` is not newer than base(). Errors: FutureRevision (newer
    /// than head()), StorageFull, ShuttingDown (`keepRunning` returned false). After an error,
    /// base() tells whether the commits were replaced.
    virtual Result<void> compact(Revision revision, const KeepRunning& keepRunning) = 0;

    /// Appends commits with the revisions from head().revision + 1 on, without gaps: all of them or
    /// none. Does nothing for an empty span. They are durable when it returns (unless the store was
    /// opened with durability `os`), and include the records that belong to them: `layers`,
    /// `namespaceChanges`, `saved` and the author's transaction number. Errors: StorageFull
    /// (nothing was written; a later call may succeed), Internal (wrong revision or hash; nothing
    /// was written), StorageFailed (unknown whether something was written; the store accepts no
    /// more commits until it is opened again).
    virtual Result<void> append(std::span<const CommitRecord> commits) = 0;

    /// Calls `visit` with each commit of [from, to] in order, until it returns false. `from` 0
    /// means the oldest existing commit; a `to` after head() means head(). Verifies the hash chain:
    /// the message of StorageCorrupt names the damaged revision. Error: HistoryReplaced (`from` is
    /// at or before base(), or compact() has removed the commits during the call).
    virtual Result<void> read(Revision from, Revision to,
                              const std::function<bool(const StoredCommit&)>& visit) const = 0;
    /// Returns the hash of the chain at `revision`, which is in [base(), head()]. Errors:
    /// HistoryReplaced, FutureRevision.
    [[nodiscard]] virtual Result<Hash> hashAt(Revision revision) const = 0;

    /// Returns all layers that a commit has edited or imported, in any order.
    [[nodiscard]] virtual Result<std::vector<LayerId>> layers() const = 0;
    /// Returns the layer at a revision; nothing if no commit concerns the layer. A `revision` after
    /// head() means head(). A layer that was imported after `revision` is returned as it was first
    /// imported. `replayed`, if not null, receives the cost. Error: HistoryReplaced (`revision` is
    /// before base()).
    [[nodiscard]] virtual Result<std::optional<LayerDoc>> layerAt(
        const LayerId& layer, Revision revision, Replayed* replayed = nullptr) const = 0;
    /// Returns a revision at which layerAt() returns the same content as at `revision`: usually the
    /// last commit that changed the layer. Nothing: no commit is for the layer. Errors: as
    /// layerAt().
    [[nodiscard]] virtual Result<std::optional<LayerVersion>> versionAt(
        const LayerId& layer, Revision revision) const = 0;
    /// Returns the layer at the newest commit.
    [[nodiscard]] Result<std::optional<LayerDoc>> loadLayer(const LayerId& layer,
                                                            Replayed* replayed = nullptr) const {
        return layerAt(layer, ~Revision(0), replayed);
    }
    /// Stores the content of a layer at a durable `revision`, whose chain hash is `hash`, so that
    /// layerAt() has fewer commits to execute. Replaces the layer's older snapshot, and does
    /// nothing if there is a newer one. A store may lose snapshots. Returns the size of the stored
    /// snapshot in bytes. Errors: LayerNotFound (no commit concerns the layer), HistoryDiverged
    /// (the revision has another hash), HistoryReplaced, StorageFull.
    virtual Result<std::size_t> keepSnapshot(const LayerId& layer, const LayerDoc& doc,
                                             Revision revision, const Hash& hash) = 0;
    /// Returns the layer's SavedState, empty if none was set.
    [[nodiscard]] virtual Result<SavedState> saved(const LayerId& layer) const = 0;
    /// Replaces the layer's SavedState. Errors: LayerNotFound (no commit concerns the layer),
    /// StorageFull.
    virtual Result<void> setSaved(const LayerId& layer, const SavedState& saved) = 0;
    /// Returns the layers whose newest commit is newer than their SavedState, in any order.
    [[nodiscard]] virtual Result<std::vector<LayerId>> unsavedLayers() const = 0;
    /// Returns the moves and deletes of the commits after `revision`, in order, as far as they are
    /// kept (kNamespaceLogRevisions).
    [[nodiscard]] virtual Result<std::vector<NamespaceChange>> namespaceChanges(
        Revision revision) const = 0;
    /// Returns the client's transactions; an empty record if the client is unknown or forgotten.
    [[nodiscard]] virtual Result<ClientRecord> clientRecord(const ClientId& client) const = 0;
    /// If the store has records of more than `most` clients, deletes the records of those whose
    /// last commit is the oldest, except for the clients in `kept`. May delete more than necessary,
    /// to be called less often. Takes long if there are many. Returns the number of deleted
    /// records.
    virtual Result<std::size_t> forgetClients(std::size_t most, const std::set<ClientId>& kept) = 0;
    /// Returns a revision after which no forgotten client has committed; 0: none was forgotten.
    [[nodiscard]] virtual Revision forgottenUpTo() const = 0;

    /// Adds a checkpoint, durable when it returns. One call at a time. Errors: CheckpointExists
    /// (the name is in use), FutureRevision (the revision is after head()), StorageFull.
    virtual Result<void> addCheckpoint(const Checkpoint& checkpoint) = 0;
    /// Returns all checkpoints, sorted by name.
    [[nodiscard]] virtual Result<std::vector<Checkpoint>> checkpoints() const = 0;

    /// Makes a store in a new folder with everything that was durable when the call began, and
    /// perhaps some later commits. Files that do not change any more are shared with it if it is on
    /// the same file system. Runs beside all other functions, except that it waits for compact().
    /// Errors: StorageFull, InvalidArgument (the folder exists, or the store is in memory). After
    /// an error the folder may be left.
    [[nodiscard]] virtual Result<void> copyTo(const std::filesystem::path& /*folder*/) const {
        return fail(ErrorCode::InvalidArgument, "a store in memory cannot be copied");
    }

    /// Measures the disk space that the store uses. Reads the sizes of its files.
    [[nodiscard]] virtual Result<StoreSpace> space() const = 0;
    /// Returns whether there is room for more commits. Called before edits are accepted, so it must
    /// be cheap. While it returns false, the project refuses edits with StorageFull.
    [[nodiscard]] virtual bool hasSpace() const = 0;
};

/// A sender of parts of big values.
struct BlobWriter {
    BlobWriter(std::uint64_t id = 0, std::string share = {})  // NOLINT: a number is a writer
        : id(id), share(std::move(share)) {}
    std::uint64_t id;
    std::string share;  ///< whose limits count, see shareOf()
};

/// A store of big values, addressed by the SHA-256 of their content.
///
/// **Threads.** All functions block. They may be called by any thread, but for the same hash and
/// writer only by one thread at a time. **Errors.** As for CommitStore.
class BlobStore {
public:
    virtual ~BlobStore() = default;
    /// Returns whether the value is complete and not dropped.
    [[nodiscard]] virtual bool has(const Hash& hash) const = 0;
    /// Returns the size of a value in bytes. Error: BlobNotFound.
    [[nodiscard]] virtual Result<std::uint64_t> size(const Hash& hash) const = 0;
    /// Adds a part of the value `hash`, which has `size` bytes. `offset` is the position of the
    /// part. The parts of a value are passed in order; offset 0 starts again. Uploads of the same
    /// value by different writers are independent until one is complete. An empty value has one
    /// empty part. Returns true if the value is complete and durable, with the right hash, also if
    /// another writer has completed it. Errors: BlobMismatch (wrong offset, size or hash),
    /// BlobTooLarge, StorageFull; the parts of this writer and value are deleted then.
    virtual Result<bool> write(const Hash& hash, std::uint64_t size, std::uint64_t offset,
                               ByteView part, const BlobWriter& writer = {}) = 0;
    /// Returns up to `count` bytes from `offset` on; fewer at the end of the value. Error:
    /// BlobNotFound.
    [[nodiscard]] virtual Result<Bytes> read(const Hash& hash, std::uint64_t offset,
                                             std::size_t count) const = 0;

    /// Deletes the incomplete values of a writer, which sends no more parts.
    virtual void forget(std::uint64_t writer) = 0;
    /// Returns all complete values, in any order. Takes long if there are many.
    [[nodiscard]] virtual Result<std::vector<Hash>> list() const = 0;
    /// Drops values: has() returns false for them until they are uploaded again. Returns at once;
    /// purge() frees their space.
    virtual void drop(std::span<const Hash> hashes) = 0;
    struct Purged {
        std::size_t values = 0;
        std::uint64_t bytes = 0;
    };
    /// Deletes up to `most` dropped values and returns their number and size; fewer than `most` if
    /// there are no more. If the process ends before a dropped value is deleted, the value is
    /// complete again in the next process.
    virtual Result<Purged> purge(std::size_t most) = 0;
};

}  // namespace usdlive::server
