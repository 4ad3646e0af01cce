// The requests of a client and their answers: each is declared here once. From the declaration
// follow its JSON (Control.cpp), its number and its end (client/session), the calls of C++, Python
// and the command line, and the check of the table in PROTOCOL.md. A new request needs its two
// structs here, its place in AnyRequest, and its meaning in server/project.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/protocol/Fields.h"

namespace usdlive {

// `request` is the number of a request: chosen by the client and unique in its connection. The
// answer repeats it. `kFeature` is the feature that a server needs to know the request; without
// one, every server knows it.

// ---- files of layers

struct LayersSaved {
    static constexpr std::string_view kType = "layersSaved";
    std::uint64_t request = 0;
    Revision revision = 0;
    std::vector<LayerId> saved;
    struct Failure {
        LayerId layer;
        std::string code;  ///< a code of errors.json
        std::string message;
        USDLIVE_FIELDS(layer, code, message)
        bool operator==(const Failure&) const = default;
    };
    std::vector<Failure> failed;
    USDLIVE_FIELDS(request, revision, saved, failed)
    bool operator==(const LayersSaved&) const = default;
};
/// Writes layers to their files.
struct SaveLayers {
    static constexpr std::string_view kType = "saveLayers";
    using Answer = LayersSaved;
    std::uint64_t request = 0;
    std::vector<LayerId> layers = {};  ///< empty: all that differ from their files
    /// True: also overwrites a file that somebody else has changed.
    std::optional<bool> force = {};
    USDLIVE_FIELDS(request, layers, force)
    bool operator==(const SaveLayers&) const = default;
};

struct LayersReloaded {
    static constexpr std::string_view kType = "layersReloaded";
    std::uint64_t request = 0;
    Revision revision = 0;
    std::vector<LayerId> reloaded;
    std::vector<LayersSaved::Failure> failed;
    USDLIVE_FIELDS(request, revision, reloaded, failed)
    bool operator==(const LayersReloaded&) const = default;
};
/// Commits the content of layers' files.
struct ReloadLayers {
    static constexpr std::string_view kType = "reloadLayers";
    using Answer = LayersReloaded;
    std::uint64_t request = 0;
    std::vector<LayerId> layers = {};  ///< empty: all that are outdated
    USDLIVE_FIELDS(request, layers)
    bool operator==(const ReloadLayers&) const = default;
};

/// The layer's file exists, and everybody can open it.
struct LayerCreated {
    static constexpr std::string_view kType = "layerCreated";
    std::uint64_t request = 0;
    LayerId layer;
    USDLIVE_FIELDS(request, layer)
    bool operator==(const LayerCreated&) const = default;
};
/// Creates a new, empty layer of the project (FI6).
struct CreateLayer {
    static constexpr std::string_view kType = "createLayer";
    static constexpr std::string_view kFeature = "createLayer";
    using Answer = LayerCreated;
    std::uint64_t request = 0;
    LayerId layer = {};
    USDLIVE_FIELDS(request, layer)
    bool operator==(const CreateLayer&) const = default;
};

/// Says whether the file is there.
struct FileUploaded {
    static constexpr std::string_view kType = "fileUploaded";
    std::uint64_t request = 0;
    std::string path;
    /// True: the project has the file with this content. False: nothing was changed, because the
    /// server does not hold the content. Upload it (B1) and send the request again.
    bool complete = false;
    USDLIVE_FIELDS(request, path, complete)
    bool operator==(const FileUploaded&) const = default;
};
/// Makes a big value, which the client has uploaded, a file of the project that is no layer (FI7).
struct UploadFile {
    static constexpr std::string_view kType = "uploadFile";
    static constexpr std::string_view kFeature = "upload";
    using Answer = FileUploaded;
    std::uint64_t request = 0;
    std::string path = {};  ///< relative to the project, see checkFilePath()
    Hash hash = {};         ///< SHA-256 of the content
    std::uint64_t size = 0;
    /// True: also replaces a file with another content.
    std::optional<bool> overwrite = {};
    USDLIVE_FIELDS(request, path, hash, size, overwrite)
    bool operator==(const UploadFile&) const = default;
};

struct SkippedFile {
    std::string path;  ///< relative to the project; bytes that are not UTF-8 are U+FFFD
    std::string reason;
    USDLIVE_FIELDS(path, reason)
    bool operator==(const SkippedFile&) const = default;
};
struct SkippedFiles {
    static constexpr std::string_view kType = "skippedFiles";
    std::uint64_t request = 0;
    std::uint64_t count = 0;         ///< number of all skipped files
    std::vector<SkippedFile> files;  ///< sorted by path, at most kMaxSkippedFiles
    USDLIVE_FIELDS(request, count, files)
    bool operator==(const SkippedFiles&) const = default;
};
inline constexpr std::size_t kMaxSkippedFiles = 1'000;
/// Lists files of the folder that look like layers and are not served (FI5).
struct ListSkipped {
    static constexpr std::string_view kType = "listSkipped";
    static constexpr std::string_view kFeature = "skipped";
    using Answer = SkippedFiles;
    std::uint64_t request = 0;
    USDLIVE_FIELDS(request)
    bool operator==(const ListSkipped&) const = default;
};

// ---- checkpoints

inline constexpr std::size_t kMaxCheckpointNameBytes = 200;
/// A named revision of the project.
struct Checkpoint {
    /// Unique in the project; 1 to kMaxCheckpointNameBytes of UTF-8, no control characters.
    std::string name;
    Revision revision = 0;
    UserName user;             ///< its author
    std::uint64_t timeMs = 0;  ///< when the server created it, since 1970
    USDLIVE_FIELDS(name, revision, user, timeMs)
    bool operator==(const Checkpoint&) const = default;
};
/// The checkpoint is stored.
struct CheckpointCreated {
    static constexpr std::string_view kType = "checkpointCreated";
    std::uint64_t request = 0;
    Checkpoint checkpoint;
    USDLIVE_FIELDS(request, checkpoint)
    bool operator==(const CheckpointCreated&) const = default;
};
/// Names the current revision, which contains all that was acknowledged to this session (CP1).
struct CreateCheckpoint {
    static constexpr std::string_view kType = "createCheckpoint";
    using Answer = CheckpointCreated;
    std::uint64_t request = 0;
    std::string name = {};
    USDLIVE_FIELDS(request, name)
    bool operator==(const CreateCheckpoint&) const = default;
};

struct Checkpoints {
    static constexpr std::string_view kType = "checkpoints";
    std::uint64_t request = 0;
    std::vector<Checkpoint> checkpoints;  ///< sorted by revision, then by name
    USDLIVE_FIELDS(request, checkpoints)
    bool operator==(const Checkpoints&) const = default;
};
struct ListCheckpoints {
    static constexpr std::string_view kType = "listCheckpoints";
    using Answer = Checkpoints;
    std::uint64_t request = 0;
    USDLIVE_FIELDS(request)
    bool operator==(const ListCheckpoints&) const = default;
};

// ---- the store

struct HistoryCompacted {
    static constexpr std::string_view kType = "historyCompacted";
    std::uint64_t request = 0;
    Revision base = 0;           ///< the oldest revision that can be read now; 0: all
    std::uint64_t replaced = 0;  ///< commits, by this request
    std::uint64_t bytesBefore = 0, bytesAfter = 0;  ///< size of the log on the disk
    std::string keptFor;  ///< the reason why newer commits of sufficient age are kept; empty: none
    USDLIVE_FIELDS(request, base, replaced, bytesBefore, bytesAfter, keptFor)
    bool operator==(const HistoryCompacted&) const = default;
};
/// Replaces commits that are older than so many days by a base (CH4).
struct CompactHistory {
    static constexpr std::string_view kType = "compactHistory";
    static constexpr std::string_view kFeature = "storage";
    using Answer = HistoryCompacted;
    std::uint64_t request = 0;
    std::optional<std::uint64_t> days = {};  ///< absent: the server's --history-days
    USDLIVE_FIELDS(request, days)
    bool operator==(const CompactHistory&) const = default;
};

/// Disk space that a layer takes, in bytes.
struct LayerStorage {
    LayerId layer;
    std::uint64_t commits = 0;    ///< number of kept commits that edit the layer
    std::uint64_t log = 0;        ///< the layer's share of them, estimated
    std::uint64_t base = 0;       ///< its content at the base
    std::uint64_t snapshots = 0;  ///< its later content
    std::uint64_t blobs = 0;      ///< number of big values that its base and its commits name
    std::uint64_t blobBytes = 0;  ///< size of these; other layers may name them, too
    USDLIVE_FIELDS(layer, commits, log, base, snapshots, blobs, blobBytes)
    bool operator==(const LayerStorage&) const = default;
};
/// Disk space that the store takes, in bytes (CH5).
struct Storage {
    static constexpr std::string_view kType = "storage";
    std::uint64_t request = 0;
    Revision revision = 0, base = 0;
    std::uint64_t oldestMs = 0;  ///< time of the oldest kept commit; 0: there is none
    std::uint64_t log = 0;       ///< commits
    std::uint64_t clients = 0;   ///< the sequence numbers of clients (M9)
    std::uint64_t records = 0;   ///< states of layers; moves and deletes; checkpoints
    std::uint64_t bases = 0, snapshots = 0;
    std::uint64_t blobs = 0, blobBytes = 0;  ///< big values: their number and their bytes
    std::uint64_t free = 0;                  ///< on that disk
    std::vector<LayerStorage> layers;        ///< sorted by name
    USDLIVE_FIELDS(request, revision, base, oldestMs, log, clients, records, bases, snapshots,
                   blobs, blobBytes, free, layers)
    bool operator==(const Storage&) const = default;
};
/// Measures what the store takes on its disk.
struct RequestStorage {
    static constexpr std::string_view kType = "requestStorage";
    static constexpr std::string_view kFeature = "storage";
    using Answer = Storage;
    std::uint64_t request = 0;
    USDLIVE_FIELDS(request)
    bool operator==(const RequestStorage&) const = default;
};

// ---- requests whose answer is several frames

/// The layer's content at `revision` follows: snapshot frames with this request number.
struct LayerOpened {
    static constexpr std::string_view kType = "layerOpened";
    std::uint64_t request = 0;
    LayerId layer;
    Revision revision = 0;
    std::uint64_t specs = 0;  ///< number of specs in the snapshot, for progress
    USDLIVE_FIELDS(request, layer, revision, specs)
    bool operator==(const LayerOpened&) const = default;
};
/// Asks for a layer's content. `revision` 0: the current content, and its commits from then on.
/// Otherwise the content at that revision, once.
struct OpenLayer {
    static constexpr std::string_view kType = "openLayer";
    using Answer = LayerOpened;
    std::uint64_t request = 0;
    LayerId layer;
    Revision revision = 0;
    USDLIVE_FIELDS(request, layer, revision)
    bool operator==(const OpenLayer&) const = default;
};

/// The requested commits follow, up to LogEnd.
struct LogBegin {
    static constexpr std::string_view kType = "logBegin";
    std::uint64_t request = 0;
    USDLIVE_FIELDS(request)
    bool operator==(const LogBegin&) const = default;
};
struct LogEnd {
    static constexpr std::string_view kType = "logEnd";
    std::uint64_t request = 0;
    USDLIVE_FIELDS(request)
    bool operator==(const LogEnd&) const = default;
};
/// Asks for commits of the past, as commit frames between LogBegin and LogEnd.
struct RequestLog {
    static constexpr std::string_view kType = "requestLog";
    using Answer = LogEnd;
    std::uint64_t request = 0;
    Revision from = 0;  ///< 0: the oldest one
    Revision to = 0;    ///< 0: the newest one
    USDLIVE_FIELDS(request, from, to)
    bool operator==(const RequestLog&) const = default;
};

// ---- the lists

/// Any request that one message answers. Each has an answer type of its own.
using AnyRequest = std::variant<SaveLayers, ReloadLayers, CreateLayer, UploadFile, ListSkipped,
                                CreateCheckpoint, ListCheckpoints, CompactHistory, RequestStorage>;

template <class T>
concept IsRequest = requires(T& message) {
    typename T::Answer;
    message.request;
};
/// A request of AnyRequest.
template <class T>
concept IsSingleRequest = IsRequest<T> && std::is_constructible_v<AnyRequest, T>;

/// The feature that a server needs for the request; empty: none.
template <IsRequest T>
constexpr std::string_view featureOf() {
    if constexpr (requires { T::kFeature; })
        return T::kFeature;
    else
        return {};
}

/// Calls `visit(request)` with one of each type of AnyRequest.
template <class Visit>
void forEachRequest(Visit&& visit) {
    [&]<std::size_t... indices>(std::index_sequence<indices...>) {
        (visit(std::variant_alternative_t<indices, AnyRequest>()), ...);
    }(std::make_index_sequence<std::variant_size_v<AnyRequest>>());
}

}  // namespace usdlive
