#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// What a commit changes in the stored state of one layer. Keyed by node, so that a move is one
/// record.
struct PutNode {
    LayerId layer;
    NodeId node = 0, parent = 0;
    std::uint64_t order = 0;
    SpecKind kind{};
    std::string name;
};
struct EraseNodes {
    LayerId layer;
    std::vector<NodeId> nodes;  ///< with all their fields
};
/// Replaces a whole field.
struct PutField {
    LayerId layer;
    NodeId node = 0;
    std::string field;
    FieldValue value;
    bool hadSamples = true;  ///< it may have held time samples, each of which is a record
};
struct EraseField {
    LayerId layer;
    NodeId node = 0;
    std::string field;
    bool hadSamples = true;
};
/// One sample of a field that holds time samples; the others stay as they are. A field that is
/// absent or holds another form becomes time samples.
struct PutSample {
    LayerId layer;
    NodeId node = 0;
    std::string field;
    double time = 0;
    Value value;
};
struct EraseSample {
    LayerId layer;
    NodeId node = 0;
    std::string field;
    double time = 0;
};
/// Everything of a layer that is not there yet.
struct PutLayer {
    LayerId layer;
    LayerDoc doc;
};
using StateChange =
    std::variant<PutNode, EraseNodes, PutField, EraseField, PutSample, EraseSample, PutLayer>;

/// A move or delete that a commit made, kept so that addresses can be carried forward over it (M3)
/// also after the server was started again.
struct NamespaceChange {
    Revision revision = 0;
    LayerId layer;
    std::string from;
    std::optional<std::string> to;  ///< nothing: deleted
    bool operator==(const NamespaceChange&) const = default;
};

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
    struct Coming {
        Revision revision = 0;
        Hash hash;
        bool operator==(const Coming&) const = default;
    };
    std::optional<Coming> coming = std::nullopt;
    bool operator==(const SavedState&) const = default;
};

/// A commit as it is appended.
struct CommitRecord {
    Revision revision = 0;
    TransactionId id;
    SharedBytes frame;  ///< encodeFrame(CommitFrame), with its length prefix
    Hash hash;          ///< chain hash after it
    std::vector<StateChange> changes;
    std::vector<NamespaceChange> namespaceChanges = {};
    /// Of the layer it brought in from its file, now or anew.
    struct Saved {
        LayerId layer;
        SavedState state;
    };
    std::optional<Saved> saved = std::nullopt;
};

struct StoredCommit {
    Revision revision = 0;
    SharedBytes frame;
    Hash hash;
};

/// Where a project's history and state are kept. One process has it open. Calls block; one thread
/// calls append(), any thread the others.
class CommitStore {
public:
    struct Head {
        Revision revision = 0;
        Hash hash;
        Epoch epoch = 0;  ///< the one this opening took
    };

    virtual ~CommitStore() = default;

    /// The newest commit that is durable.
    [[nodiscard]] virtual Head head() const = 0;

    /// Appends a group, all or nothing, state with it; durable when it returns (unless opened with
    /// durability `os`). Revisions contiguous from head().revision + 1. Errors: StorageFull
    /// (nothing was written; goes on when there is space again), StorageFailed (the store takes no
    /// more appends; it has to be opened anew).
    virtual Result<void> append(std::span<const CommitRecord> commits) = 0;

    /// Calls `visit` with each commit of [from, to] in order until it returns false. Checks the
    /// chain as it goes: StorageCorrupt names the revision.
    virtual Result<void> read(Revision from, Revision to,
                              const std::function<bool(const StoredCommit&)>& visit) const = 0;
    [[nodiscard]] virtual Result<Hash> hashAt(Revision revision) const = 0;

    /// Layers that have state.
    [[nodiscard]] virtual Result<std::vector<LayerId>> layers() const = 0;
    /// Nothing: never imported.
    [[nodiscard]] virtual Result<std::optional<LayerDoc>> loadLayer(const LayerId& layer) const = 0;
    /// LayerNotFound for setSaved() of a layer without state.
    [[nodiscard]] virtual Result<SavedState> saved(const LayerId& layer) const = 0;
    virtual Result<void> setSaved(const LayerId& layer, const SavedState& saved) = 0;
    /// Layers that commits have changed since they were last saved.
    [[nodiscard]] virtual Result<std::vector<LayerId>> unsavedLayers() const = 0;
    /// The moves and deletes of the commits after `revision`, in order: what Project is made with.
    [[nodiscard]] virtual Result<std::vector<NamespaceChange>> namespaceChanges(
        Revision revision) const = 0;
    /// M9: the revision that committed this transaction, if it is among the client's last 1,024.
    [[nodiscard]] virtual Result<std::optional<Revision>> committed(
        const TransactionId& transaction) const = 0;
    /// The highest number of a client's committed transactions, 0 none.
    [[nodiscard]] virtual Result<std::uint64_t> lastSequence(const ClientId& client) const = 0;

    /// Durable when it returns. CheckpointExists; FutureRevision. One call at a time.
    virtual Result<void> addCheckpoint(const Checkpoint& checkpoint) = 0;
    /// By name.
    [[nodiscard]] virtual Result<std::vector<Checkpoint>> checkpoints() const = 0;

    /// Is there room for more? Cheap; asked before edits are accepted. False makes the project
    /// refuse edits with StorageFull until it is true again.
    [[nodiscard]] virtual bool hasSpace() const = 0;
};

/// Big values by content. Same threads rule as CommitStore: any thread, one writer for a hash.
class BlobStore {
public:
    virtual ~BlobStore() = default;
    [[nodiscard]] virtual bool has(const Hash& hash) const = 0;
    [[nodiscard]] virtual Result<std::uint64_t> size(const Hash& hash) const = 0;
    /// Adds a part; parts of one value come in order from offset 0 (which starts anew). True when
    /// the value is whole, its hash right, and it is durable. Errors: BlobMismatch, BlobTooLarge,
    /// StorageFull, StorageFailed; the parts so far are thrown away.
    virtual Result<bool> write(const Hash& hash, std::uint64_t size, std::uint64_t offset,
                               ByteView part) = 0;
    /// Up to `count` bytes; BlobNotFound.
    [[nodiscard]] virtual Result<Bytes> read(const Hash& hash, std::uint64_t offset,
                                             std::size_t count) const = 0;
};

}  // namespace usdlive::server
