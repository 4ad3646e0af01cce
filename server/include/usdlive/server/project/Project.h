// One project: the interface between what decides and the process around it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"
#include "usdlive/server/project/CommitStore.h"
#include "usdlive/server/project/ports/Ports.h"

namespace usdlive::server {

/// How far the history may be replaced by a base.
struct BaseLimit {
    Revision revision = 0;
    std::string keptFor;  ///< why not further, though commits are old enough; empty: they are not
};
/// Takes time. The last commit that was made before `beforeMs`, but none after `upTo` or after the
/// oldest checkpoint.
[[nodiscard]] Result<BaseLimit> findBase(const CommitStore& store, std::int64_t beforeMs,
                                         Revision upTo);
/// The result of ports::History::compact().
struct CompactOutcome {
    std::uint64_t bytesBefore = 0, bytesAfter = 0;  ///< of the log
};

/// The commit that imports a whole layer from its file, without its place in the history.
struct LayerImport {
    ImportFrame frame;        ///< stampCommit() writes its place into it
    std::vector<Hash> blobs;  ///< that it names
};
/// Any thread; takes time. LayerUnreadable: larger than one commit can be.
[[nodiscard]] Result<LayerImport> makeImport(const LayerId& layer, const LayerDoc& doc);

struct LoadedLayer {
    LayerDoc doc;
    std::optional<LayerImport> import = std::nullopt;  ///< it came from its file
    SavedState saved = {};  ///< what its file has; an import has no revision yet
    Replayed replayed = {};
};

/// A layer's file, as edits that make the layer be like it.
struct ReloadedLayer {
    std::vector<Edit> edits;  ///< paths absolute, each valid after the ones before
    LayerDoc doc;             ///< the file's content, with the node ids of `present`
    FileStamp file;
};
/// Any thread; takes time. `content` is what the file holds, `present` what the layer does. Specs
/// of one path and kind are taken to be the same.
[[nodiscard]] ReloadedLayer makeReload(const LayerId& layer, const LayerDoc& present,
                                       const LayerDoc& content, const FileStamp& file);

/// The result of each SaveJob.
struct SaveOutcome {
    Revision revision = 0;
    std::vector<std::pair<LayerId, FileStamp>> saved;
    std::vector<LayersSaved::Failure> failed;
};

/// The state of the store when a project is created over it.
struct StoreState {
    CommitStore::Head head;
    CommitStore::Base base = {};
    /// Those after Project::firstNamespaceRevision(), so that transactions that were sent before
    /// the start still find their specs (M3).
    std::vector<NamespaceChange> namespaceChanges = {};
    std::vector<LayerId> unsaved = {};  ///< their stored state is newer than their file
    Revision forgottenUpTo = 0;         ///< CommitStore::forgottenUpTo()
    bool hasSpace = true;
};

/// Counts for /metrics, all since the start.
struct ProjectCounters {
    std::uint64_t commits = 0, edits = 0, dropped = 0, refused = 0, previews = 0, duplicates = 0;
    std::uint64_t delivered = 0;  ///< commit frames handed to sessions
    std::uint64_t unloaded = 0;   ///< layers
};

/// The authority over one project: greets sessions, executes and orders their transactions, sends
/// the commits to everybody. Decides without I/O; belongs to one strand and has no mutex.
class Project {
public:
    struct Options {
        std::string name;
        std::size_t maxFrameBytes = kMaxFrameBytes;
        std::uint64_t maxBlobBytes = 4ull << 30;
        std::size_t maxEditsPerTransaction = kMaxTransactionEdits;
        std::uint64_t maxTransactionBytes = kMaxTransactionBytes;  ///< in parts (FR8)
        /// Commits that are larger than this, or than a frame, go in parts of about `partBytes`.
        std::size_t wholeCommitBytes = kMaxFrameBytes;
        std::size_t partBytes = kPartBytes;
        std::size_t maxSessions = 1'000;
        std::size_t recentCommitBytes = 64ull << 20;  ///< kept in memory for who resumes
        std::size_t namespaceLogRevisions =
            kNamespaceLogRevisions;    ///< how far back a base may lie
        Revision maxBehind = 100'000;  ///< commits that a session may lag by; then it is cut
        std::size_t leastReplay = kLeastReplay;  ///< see snapshotDue()
        /// From one snapshot of a layer to the next, also when much is written: they cost time.
        std::int64_t snapshotIntervalMs = 10'000;
        std::set<UserName> administrators = {};  ///< who may edit and unlock what others lock
        /// Others may take a lock when its holder has not been connected for so long.
        std::int64_t lockTakeoverMs = 15 * 60'000;
        /// Layers that nobody has open stay in memory for so long, and all of them together
        /// take about so much.
        std::int64_t idleLayerMs = 60'000;
        std::size_t idleLayerBytes = 256ull << 20;
        /// A big value that nothing names is kept for so long (B6).
        std::int64_t keepUnusedBlobsMs = 15 * 60'000;
        std::optional<std::uint64_t> historyDays = {};  ///< older commits are replaced by a base
    };

    /// `files`: what is served, also the layers that only the store has. All are listed, none is
    /// loaded.
    Project(Options options, Ports ports, StoreState store, const std::vector<LayerFile>& files);
    ~Project();

    /// The revision to pass to CommitStore::namespaceChanges().
    [[nodiscard]] static Revision firstNamespaceRevision(const Options& options,
                                                         const CommitStore::Head& head) {
        return head.revision - std::min<Revision>(head.revision, options.namespaceLogRevisions);
    }

    // Sessions.
    void connected(SessionId session);
    /// Receives one message. The session is closed with an error if the message is not of the
    /// protocol.
    void received(SessionId session, ByteView message);
    void disconnected(SessionId session);
    /// It is no longer ports::Outbox::congested().
    void drained(SessionId session);

    // Answers of the ports.
    void appended(Revision upTo);
    /// Takes back everything after the store's head: authors get refusals with `error`, the layers
    /// concerned are loaded again, sessions continue. Commits that were handed to append() before
    /// this call must not be appended after it. If `head` has a higher epoch, the store was opened
    /// again.
    void appendFailed(Error error, CommitStore::Head head);
    /// An append has failed, and only opening the store again shows what is in it; appendFailed()
    /// is to be called then. Until then nothing is asked of the store; new transactions are refused
    /// (SE8), and those that it may know wait.
    void storeClosed();
    void layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded);
    /// loadLayer() found nothing: the layer's file is asked for.
    void layerNotStored(const LayerId& layer);
    void snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes);
    void commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits);
    void historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc);
    /// readHistory() found nothing: the layer's file is asked for.
    void historyNotStored(SessionId session, std::uint64_t request);
    void clientRead(const ClientId& client, const Result<ClientRecord>& record);
    /// `stored`: those of `asked` that are.
    void blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored);
    void blobWritten(SessionId session, const Hash& hash, Result<bool> whole);
    void layersSaved(SessionId session, std::uint64_t request, SaveOutcome outcome);
    /// A save that takes long is at `layer`, after `done` of `total` layers (PG1).
    void layersBeingSaved(SessionId session, std::uint64_t request, const LayerId& layer,
                          std::size_t done, std::size_t total);
    /// importLayer() has begun to read the layer's file (PG1).
    void layerBeingImported(const LayerId& layer);
    void layerCreated(SessionId session, std::uint64_t request, const LayerId& layer,
                      const Result<void>& created);
    void skippedListed(SessionId session, std::uint64_t request,
                       Result<std::vector<SkippedFile>> skipped);
    void fileChecked(const LayerId& layer, Result<std::optional<FileStamp>> file);
    void layerReloaded(SessionId session, std::uint64_t request, const LayerId& layer,
                       Result<ReloadedLayer> reloaded);

    void checkpointAdded(SessionId session, std::uint64_t request, const Result<Checkpoint>& added);
    void checkpointsRead(SessionId session, std::uint64_t request,
                         Result<std::vector<Checkpoint>> checkpoints);

    /// Has commits older than Options::historyDays replaced. To be called now and then.
    void boundHistory();
    void baseFound(Result<BaseLimit> limit);
    /// The history begins at this base from now on.
    void baseChanged(const CommitStore::Base& base);
    void compacted(const Result<CompactOutcome>& outcome);
    void storageMeasured(SessionId session, std::uint64_t request, Result<Storage> storage);

    /// Whether the store has room for more: edits are refused with StorageFull while it has none
    /// (SE8). To be called when that has changed.
    void setSpace(bool hasSpace);

    /// To be called when the project's folder has changed. `files` contains the layers that only
    /// the store has, too.
    void setFiles(const std::vector<LayerFile>& files);

    /// To be called now and then, also while nothing happens.
    void unloadIdle();

    /// Sends everybody the presences that changed, and those that ended. To be called every
    /// kSweepMs while hasPresence(); `nowMs`: any steady clock.
    void sweep(std::int64_t nowMs);
    static constexpr std::int64_t kSweepMs = 1'000 / kPresencesPerSecond;
    [[nodiscard]] bool hasPresence() const;

    /// The clients that are connected, and those whose commits are not durable yet. The store must
    /// not forget them (M14): a transaction of theirs that is not answered yet may be committed
    /// already, and be sent once more.
    [[nodiscard]] std::set<ClientId> activeClients() const;
    /// CommitStore::forgottenUpTo() has changed to this.
    void clientsForgotten(Revision upTo);

    /// B6. `unnamed`: big values that the store holds and nothing in it names, as of its revision
    /// `upTo`. Returns those that nothing here names either, and that were of no use for long
    /// enough, by `nowMs` of any steady clock: to be dropped (BlobStore::drop) before anything else
    /// is called. To be called now and then, also without any, as it forgets what it noted.
    [[nodiscard]] std::vector<Hash> unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                                std::int64_t nowMs);

    [[nodiscard]] Revision durableRevision() const;
    [[nodiscard]] const ProjectCounters& counters() const;
    [[nodiscard]] std::size_t sessionCount() const;
    /// A loaded layer as executed so far (ahead of what is durable); nullptr otherwise.
    [[nodiscard]] const LayerDoc* layer(const LayerId& layer) const;

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

/// Any thread; takes time.
[[nodiscard]] Result<StoreState> readState(const CommitStore& store,
                                           const Project::Options& options);

}  // namespace usdlive::server
