#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"

namespace usdlive {

// Control messages: JSON objects with a member "type" (the struct's name in camelCase) and members
// named as below. Unknown members are ignored; unknown types are answered with `malformedControl`.

/// Client's first message.
struct Hello {
    int protocol = 0;        ///< newest the client speaks
    int oldestProtocol = 0;  ///< oldest
    std::vector<std::string> features;
    ClientId client;
    UserName user;
    std::string application;
    /// Set when resuming: what the client has applied, and the chain hash there.
    struct Resume {
        Epoch epoch = 0;
        Revision revision = 0;
        Hash hash;
        bool operator==(const Resume&) const = default;
    };
    std::optional<Resume> resume;
    /// When resuming: the layers it has open.
    std::optional<std::vector<LayerId>> open;
    bool operator==(const Hello&) const = default;
};
struct LayerInfo {
    LayerId layer;
    bool operator==(const LayerInfo&) const = default;
};
/// The answer. After it the server sends every commit after `revision`; to a resumed session every
/// commit after Hello::resume.revision, the ones up to `revision` among them.
struct Welcome {
    int protocol = 0;
    std::vector<std::string> features;
    std::string project;
    Epoch epoch = 0;
    Revision revision = 0;  ///< the newest durable one
    Hash hash;              ///< chain hash at `revision`
    /// False when Hello::resume was absent or could not be met (an ErrorMessage before this one
    /// says why): the client forgets its layers' confirmed content and opens them again.
    bool resumed = false;
    std::vector<LayerInfo> layers;
    std::uint64_t maxFrameBytes = 0;
    std::uint64_t maxBlobBytes = 0;
    std::optional<bool> administrator = {};  ///< is the user one? Locks do not bind them (LK1)
    std::optional<Revision> base = {};       ///< commits up to this one were replaced (CH4)
    std::optional<std::uint64_t> maxTransactionBytes = {};  ///< of one in parts (FR8)
    bool operator==(const Welcome&) const = default;
};
/// Server: what the project has now, whenever that is other than `welcome` said.
struct ProjectLayers {
    std::vector<LayerInfo> layers;
    bool operator==(const ProjectLayers&) const = default;
};
/// Client: send me this layer. `revision` 0: as it is now, and its commits from then on. Otherwise
/// as it was, once (`usdlive cat --revision`).
struct OpenLayer {
    std::uint64_t request = 0;  ///< chosen by the client, unique in the session
    LayerId layer;
    Revision revision = 0;
    bool operator==(const OpenLayer&) const = default;
};
/// Server: snapshot frames with this request number follow; the layer stands at `revision`.
struct LayerOpened {
    std::uint64_t request = 0;
    LayerId layer;
    Revision revision = 0;
    std::uint64_t specs = 0;  ///< how many the snapshot has, for progress
    bool operator==(const LayerOpened&) const = default;
};
struct CloseLayer {
    LayerId layer;
    bool operator==(const CloseLayer&) const = default;
};
/// Client: send me the big value, from `offset`.
struct RequestBlob {
    Hash hash;
    std::uint64_t offset = 0;
    bool operator==(const RequestBlob&) const = default;
};
/// Server: an uploaded big value is whole and safe on disk; transactions may name it.
struct BlobStored {
    Hash hash;
    bool operator==(const BlobStored&) const = default;
};
/// Server: a transaction that was sent twice is committed already (M9).
struct AlreadyCommitted {
    std::uint64_t sequence = 0;
    Revision revision = 0;
    bool operator==(const AlreadyCommitted&) const = default;
};
/// Client: make a new, empty layer of the project (FI6). Feature `createLayer`.
struct CreateLayer {
    std::uint64_t request = 0;
    LayerId layer;
    bool operator==(const CreateLayer&) const = default;
};
/// Server: its file is there, and everybody may open it.
struct LayerCreated {
    std::uint64_t request = 0;
    LayerId layer;
    bool operator==(const LayerCreated&) const = default;
};
/// Client: which files of the folder are no layers, although they look like some (FI5)? Feature
/// `skipped`.
struct ListSkipped {
    std::uint64_t request = 0;
    bool operator==(const ListSkipped&) const = default;
};
struct SkippedFile {
    std::string path;  ///< relative to the project; bytes that are not UTF-8 are U+FFFD
    std::string reason;
    bool operator==(const SkippedFile&) const = default;
};
/// Server: sorted by path, at most kMaxSkippedFiles of the `count` there are.
struct SkippedFiles {
    std::uint64_t request = 0;
    std::uint64_t count = 0;
    std::vector<SkippedFile> files;
    bool operator==(const SkippedFiles&) const = default;
};
inline constexpr std::size_t kMaxSkippedFiles = 1'000;
/// Server: how far a request is that takes long (PG1). Feature `progress`.
struct RequestProgress {
    std::uint64_t request = 0;
    std::string task;  ///< "import", "save"
    LayerId layer;     ///< that it is at
    std::uint64_t done = 0;
    std::uint64_t total = 0;  ///< 0: not known
    bool operator==(const RequestProgress&) const = default;
};
/// Client: write these layers (none named: all that differ) to their files. `force`: also over what
/// somebody else has put there meanwhile.
struct SaveLayers {
    std::uint64_t request = 0;
    std::vector<LayerId> layers;
    std::optional<bool> force = {};
    bool operator==(const SaveLayers&) const = default;
};
struct LayersSaved {
    std::uint64_t request = 0;
    Revision revision = 0;
    std::vector<LayerId> saved;
    struct Failure {
        LayerId layer;
        std::string code;
        std::string message;
        bool operator==(const Failure&) const = default;
    };
    std::vector<Failure> failed;
    bool operator==(const LayersSaved&) const = default;
};
/// Client: take the files of these layers (none named: of all that are outdated) as a commit.
struct ReloadLayers {
    std::uint64_t request = 0;
    std::vector<LayerId> layers;
    bool operator==(const ReloadLayers&) const = default;
};
struct LayersReloaded {
    std::uint64_t request = 0;
    Revision revision = 0;
    std::vector<LayerId> reloaded;
    std::vector<LayersSaved::Failure> failed;
    bool operator==(const LayersReloaded&) const = default;
};
/// Client: commits from `from` (0: the oldest there is) to `to` (0: newest) again, as commit frames
/// between LogBegin and LogEnd; for `usdlive log`.
struct RequestLog {
    std::uint64_t request = 0;
    Revision from = 0;
    Revision to = 0;
    bool operator==(const RequestLog&) const = default;
};
struct LogBegin {
    std::uint64_t request = 0;
    bool operator==(const LogBegin&) const = default;
};
struct LogEnd {
    std::uint64_t request = 0;
    bool operator==(const LogEnd&) const = default;
};
/// A named revision of the project.
struct Checkpoint {
    std::string name;  ///< unique in the project; 1 to 200 bytes of UTF-8, no control characters
    Revision revision = 0;
    UserName user;             ///< who made it
    std::uint64_t timeMs = 0;  ///< since 1970, when the server did
    bool operator==(const Checkpoint&) const = default;
};
/// Client: name what the project is now, with all that was acknowledged to this session (CP1).
struct CreateCheckpoint {
    std::uint64_t request = 0;
    std::string name;
    bool operator==(const CreateCheckpoint&) const = default;
};
/// Server: it is stored.
struct CheckpointCreated {
    std::uint64_t request = 0;
    Checkpoint checkpoint;
    bool operator==(const CheckpointCreated&) const = default;
};
/// Client: which are there?
struct ListCheckpoints {
    std::uint64_t request = 0;
    bool operator==(const ListCheckpoints&) const = default;
};
/// Server: by revision, then by name.
struct Checkpoints {
    std::uint64_t request = 0;
    std::vector<Checkpoint> checkpoints;
    bool operator==(const Checkpoints&) const = default;
};
/// Client: replace the commits that are older than so many days by a base (CH4). Feature `storage`.
struct CompactHistory {
    std::uint64_t request = 0;
    std::optional<std::uint64_t> days = {};  ///< nothing: as the server was told when it started
    bool operator==(const CompactHistory&) const = default;
};
/// Server: it is done.
struct HistoryCompacted {
    std::uint64_t request = 0;
    Revision base = 0;           ///< the oldest revision that can be read now; 0: all
    std::uint64_t replaced = 0;  ///< commits, by this request
    std::uint64_t bytesBefore = 0, bytesAfter = 0;  ///< that the log takes on the disk
    std::string keptFor;  ///< who needs commits that are old enough; empty: nobody
    bool operator==(const HistoryCompacted&) const = default;
};
/// Client: what takes the space? Feature `storage`.
struct RequestStorage {
    std::uint64_t request = 0;
    bool operator==(const RequestStorage&) const = default;
};
/// What a layer takes, in bytes.
struct LayerStorage {
    LayerId layer;
    std::uint64_t commits = 0;    ///< for it, of those that are kept
    std::uint64_t log = 0;        ///< its part of them, about
    std::uint64_t base = 0;       ///< what it held at the base
    std::uint64_t snapshots = 0;  ///< what it held later
    std::uint64_t blobs = 0;      ///< big values that its base and its commits name
    std::uint64_t blobBytes = 0;  ///< of these; others may name them, too
    bool operator==(const LayerStorage&) const = default;
};
/// Server: what the store takes on its disk, in bytes.
struct Storage {
    std::uint64_t request = 0;
    Revision revision = 0, base = 0;
    std::uint64_t oldestMs = 0;  ///< when the oldest commit that is kept was made; 0: there is none
    std::uint64_t log = 0;       ///< commits
    std::uint64_t clients = 0;   ///< what clients have sent, by their ids (M9)
    std::uint64_t records = 0;   ///< what is known of layers; moves and deletes; checkpoints
    std::uint64_t bases = 0, snapshots = 0;
    std::uint64_t blobs = 0, blobBytes = 0;
    std::uint64_t free = 0;            ///< on that disk
    std::vector<LayerStorage> layers;  ///< by name
    bool operator==(const Storage&) const = default;
};
/// What is known of a layer beside its content. Feature `states`.
struct LayerState {
    LayerId layer;
    Revision revision = 0;  ///< the newest that had changed it when this was told; 0: not known
    Revision saved = 0;     ///< the revision in its file; 0: not known
    bool dirty = false;     ///< differs from its file
    bool outdated = false;  ///< its file was changed behind the server
    bool globallyMuted = false;  ///< on the stages of a layer that somebody has opened
    bool writable = true;        ///< its file, for the server
    std::string owner;           ///< of its file; empty: not known
    bool locked = false;
    UserName holder;                ///< of the lock; empty: nobody is named
    std::uint64_t lockedAtMs = 0;   ///< since 1970, as the holder's clock said; 0: not known
    std::vector<UserName> editors;  ///< who has it open, sorted, each once
    bool operator==(const LayerState&) const = default;
};
/// Server: the states that changed; after the welcome all that are not as a LayerState is made.
struct LayerStates {
    std::vector<LayerState> layers;
    bool operator==(const LayerStates&) const = default;
};

/// Where somebody is. Feature `presence`. Never stored.
struct Presence {
    ClientId client;  ///< filled in by the server, as the next two
    UserName user;
    std::string application;
    std::vector<std::string> selection;  ///< paths
    std::vector<double> camera;          ///< a matrix of 16, by rows, or nothing
    std::optional<double> time;          ///< time code
    std::string editTarget;              ///< a layer, or nothing
    std::string data;                    ///< free: JSON for those who know what is meant
    bool operator==(const Presence&) const = default;
};
/// Client: where I am now, at most kPresencesPerSecond; an unchanged one is said again every
/// kPresenceRepeatMs, and who is not heard of for kPresenceTimeMs is gone.
struct ShowPresence {
    Presence presence;
    bool operator==(const ShowPresence&) const = default;
};
inline constexpr int kPresencesPerSecond = 20;
inline constexpr std::int64_t kPresenceRepeatMs = 1'000;
inline constexpr std::int64_t kPresenceTimeMs = 3'000;
/// Server: those of others that changed, and who is gone.
struct Presences {
    std::vector<Presence> shown;
    std::vector<ClientId> gone;
    bool operator==(const Presences&) const = default;
};

/// Server: what went wrong. `closing`: the connection ends with it. `request`: the one it answers.
struct ErrorMessage {
    std::string code;  ///< of errors.json
    std::string message;
    bool closing = false;
    std::optional<std::uint64_t> request;
    std::optional<Hash> blob;
    bool operator==(const ErrorMessage&) const = default;
};

using ControlMessage =
    std::variant<Hello, Welcome, ProjectLayers, OpenLayer, LayerOpened, CloseLayer, RequestBlob,
                 BlobStored, AlreadyCommitted, SaveLayers, LayersSaved, ReloadLayers,
                 LayersReloaded, RequestLog, LogBegin, LogEnd, CreateCheckpoint, CheckpointCreated,
                 ListCheckpoints, Checkpoints, CompactHistory, HistoryCompacted, RequestStorage,
                 Storage, LayerStates, ShowPresence, Presences, ErrorMessage, CreateLayer,
                 LayerCreated, ListSkipped, SkippedFiles, RequestProgress>;

[[nodiscard]] std::string encodeControl(const ControlMessage& message);
/// MalformedControl with what is missing or wrong. Nesting and lengths are bounded.
[[nodiscard]] Result<ControlMessage> decodeControl(std::string_view json);

}  // namespace usdlive
