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
using StateChange = std::variant<PutNode, EraseNodes, PutField, EraseField, PutSample, EraseSample>;

/// A move or delete that a commit made, kept so that addresses can be carried forward over it (M3)
/// also after the server was started again.
struct NamespaceChange {
    Revision revision = 0;
    LayerId layer;
    std::string from;
    std::optional<std::string> to;  ///< nothing: deleted
    bool operator==(const NamespaceChange&) const = default;
};

/// A commit as it is appended.
struct CommitRecord {
    Revision revision = 0;
    TransactionId id;
    SharedBytes frame;  ///< encodeFrame(CommitFrame), with its length prefix
    Hash hash;          ///< chain hash after it
    std::vector<StateChange> changes;
    std::vector<NamespaceChange> namespaceChanges = {};
    /// The layer it brought in from its file: that counts as saved.
    std::optional<LayerId> imported = std::nullopt;
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
    /// The revision at which a layer was last saved to its file, 0 never.
    [[nodiscard]] virtual Result<Revision> savedRevision(const LayerId& layer) const = 0;
    virtual Result<void> setSavedRevision(const LayerId& layer, Revision revision) = 0;
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

    virtual Result<void> setCheckpoint(const std::string& name, Revision revision) = 0;
    [[nodiscard]] virtual Result<std::vector<std::pair<std::string, Revision>>> checkpoints()
        const = 0;

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
