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

namespace usdlive::server {

/// One connection, as long as it lasts.
using SessionId = std::uint64_t;

/// What is told to all alike, and is worth nothing once something newer was told.
using News = std::variant<LayerStates, Presences>;
/// A frame of it; nullptr: there is nothing to say.
[[nodiscard]] SharedBytes encodeNews(const News& news);

/// What a project asks of the process around it. Calls come from the project's strand and return at
/// once; answers come back as calls of Project on the same strand. The server's app implements it
/// with threads and sockets, the simulation with a queue and a seed.
class ProjectHost {
public:
    virtual ~ProjectHost() = default;

    /// Sends encoded frames to a session, in order. Bounded by the host: who does not read is cut
    /// with SlowReader and reported by Project::disconnected().
    virtual void send(SessionId session, SharedBytes frames) = 0;
    /// Sends the commit `revision` to all of `sessions`, which are live and ascending, in order
    /// with the rest that each is sent. A host that can sends it once for many.
    virtual void sendCommit(std::span<const SessionId> sessions, SharedBytes frame, Revision) {
        for (const SessionId session : sessions) send(session, frame);
    }
    /// A live session gets something else than live commits for a while, which must not stand
    /// between it: until releaseCommits(). True: it may have got later commits than those sent to
    /// it, as the host sends them to all.
    virtual bool holdCommits(SessionId) { return false; }
    /// The session is live: from here on it gets the commits from `next` on, as they are sent.
    virtual void releaseCommits(SessionId, Revision /*next*/) {}
    /// Tells `news` to all of `sessions`, ascending, each of which has been told what was so far. A
    /// host that can tells it once for many, and to more than these.
    virtual void tell(std::span<const SessionId> sessions, const News& news) {
        const SharedBytes frame = encodeNews(news);
        for (const SessionId session : sessions)
            if (frame) send(session, frame);
    }
    /// Tells a session what is so far, in order with the rest that it is sent.
    virtual void tellFirst(SessionId session, const News& all) {
        if (SharedBytes frame = encodeNews(all)) send(session, std::move(frame));
    }
    /// Is so much queued for the session that history should wait? Then no more commits of the past
    /// are sent to it until Project::drained().
    [[nodiscard]] virtual bool congested(SessionId) { return false; }
    /// The same, of a session whose live commits queue up for it: it gets no more of them until
    /// drained(), and then those of the past.
    [[nodiscard]] virtual bool lags(SessionId session) { return congested(session); }
    /// Sends what is queued, then closes.
    virtual void close(SessionId session) = 0;

    /// Appends to the store, in order; answered by appended() or appendFailed().
    virtual void append(CommitRecord commit) = 0;
    /// CommitStore::keepSnapshot(), of a revision that is durable; answered by snapshotKept().
    /// Nothing waits for it.
    virtual void keepSnapshot(const LayerId&, LayerDoc, Revision, const Hash&) {}
    /// From the store, or, if it has none, from the layer's file; answered by layerLoaded().
    virtual void loadLayer(const LayerId& layer) = 0;
    /// Commits of [from, to] from the store, answered by commitsRead().
    virtual void readCommits(SessionId session, Revision from, Revision to) = 0;
    /// The layer as it was; answered by historyRead().
    virtual void readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                             Revision revision) = 0;
    /// Encodes and sends a snapshot, chunk by chunk, beside the stream.
    virtual void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) = 0;
    /// Sends a big value from `offset` on, beside the stream.
    virtual void sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) = 0;
    /// Sends these frames beside the stream, in order.
    virtual void sendBeside(SessionId session, std::vector<SharedBytes> frames) {
        for (SharedBytes& frame : frames) send(session, std::move(frame));
    }
    /// Adds a part of a big value; answered by blobWritten(). Sessions that upload the same value
    /// do so each for itself.
    virtual void writeBlob(SessionId session, BlobFrame part) = 0;
    [[nodiscard]] virtual bool hasBlob(const Hash& hash) = 0;
    [[nodiscard]] virtual bool hasSpace() = 0;
    /// Writes layers to their files, in the order asked; answered by layersSaved().
    struct SaveJob {
        LayerId layer;
        LayerDoc doc;
        Revision revision = 0;
        SavedState saved = {};  ///< as far as known
        /// A file that holds neither what was saved nor what was about to be is left as it is.
        bool minds = false;
    };
    virtual void saveLayers(SessionId session, std::uint64_t request,
                            std::vector<SaveJob> jobs) = 0;
    /// CommitStore::addCheckpoint(), in the order asked; answered by checkpointAdded().
    virtual void addCheckpoint(SessionId, std::uint64_t /*request*/, const Checkpoint&) {}
    /// CommitStore::checkpoints(), after those added so far; answered by checkpointsRead().
    virtual void readCheckpoints(SessionId, std::uint64_t /*request*/) {}
    /// Looks what the layer's file holds, after the saves asked for so far; answered by
    /// fileChecked().
    virtual void checkFile(const LayerId&) {}
    /// Reads the layer's file and compares it with `present`, as makeReload() does; answered by
    /// layerReloaded().
    virtual void reloadLayer(SessionId, std::uint64_t /*request*/, const LayerId&,
                             LayerDoc /*present*/) {}
    /// CommitStore::setSaved(); nothing waits for it.
    virtual void setSaved(const LayerId&, const SavedState&) {}
    /// Makes an empty layer's file; answered by layerCreated().
    virtual void createLayerFile(SessionId session, std::uint64_t request,
                                 const LayerId& layer) = 0;
    /// Looks for files that are not served; answered by skippedListed().
    virtual void listSkipped(SessionId session, std::uint64_t request) = 0;
    /// Somebody did something, or was refused it: for the log. `what` is a few words that never
    /// vary; `layer` and `detail` may be empty, and hold what clients sent.
    struct Happening {
        std::string_view what;
        const UserName& user;
        LayerId layer = {};
        std::string detail = {};
    };
    virtual void happened(const Happening& happening) = 0;
    /// Layers whose stored state is newer than their file (CommitStore::unsavedLayers).
    [[nodiscard]] virtual std::vector<LayerId> unsavedLayers() { return {}; }
    /// M9; from the store.
    [[nodiscard]] virtual std::optional<Revision> committed(const TransactionId& transaction) = 0;
    /// No transaction of the client with a higher number is in the store. Asked once for each
    /// author who comes.
    [[nodiscard]] virtual std::uint64_t lastSequence(const ClientId&) { return ~std::uint64_t(0); }
    /// CommitStore::forgottenUpTo().
    [[nodiscard]] virtual Revision forgottenUpTo() { return 0; }
    [[nodiscard]] virtual std::int64_t wallClockMs() = 0;

    /// CommitStore::base().
    [[nodiscard]] virtual CommitStore::Base base() { return {}; }
    /// findBase() in the store, after the checkpoints added so far; answered by baseFound().
    virtual void findBase(std::int64_t /*beforeMs*/, Revision /*upTo*/) {}
    /// CommitStore::compact(); takes long, and everything else goes on; answered by compacted().
    virtual void compact(Revision) {}
    /// Finds out what the store takes; answered by storageMeasured().
    virtual void measureStorage(SessionId, std::uint64_t /*request*/) {}
};

/// How far the history may be replaced by a base.
struct BaseLimit {
    Revision revision = 0;
    std::string keptFor;  ///< why not further, though commits are old enough; empty: they are not
};
/// Takes time. The last commit that was made before `beforeMs`, but none after `upTo` or after the
/// oldest checkpoint.
[[nodiscard]] Result<BaseLimit> findBase(const CommitStore& store, std::int64_t beforeMs,
                                         Revision upTo);
/// What became of ProjectHost::compact().
struct CompactOutcome {
    std::uint64_t bytesBefore = 0, bytesAfter = 0;  ///< of the log
};

/// The commit that brings a whole layer in from its file, but for its place in the history.
struct LayerImport {
    ImportFrame frame;        ///< stampCommit() says where it stands
    std::vector<Hash> blobs;  ///< that it names
};
/// Any thread; takes time. LayerUnreadable: larger than one commit can be.
[[nodiscard]] Result<LayerImport> makeImport(const LayerId& layer, const LayerDoc& doc);

struct LoadedLayer {
    LayerDoc doc;
    std::optional<LayerImport> import = std::nullopt;  ///< it came from its file
    SavedState saved = {};  ///< what its file has; of an import without a revision yet
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

/// What became of a SaveJob each.
struct SaveOutcome {
    Revision revision = 0;
    std::vector<std::pair<LayerId, FileStamp>> saved;
    std::vector<LayersSaved::Failure> failed;
};

/// Counts for /metrics, all since the start.
struct ProjectCounters {
    std::uint64_t commits = 0, edits = 0, dropped = 0, refused = 0, previews = 0, duplicates = 0;
    std::uint64_t delivered = 0;  ///< commit frames handed to sessions
    std::uint64_t unloaded = 0;   ///< layers
};

/// The authority over one project: greets sessions, orders and executes their transactions, tells
/// everybody. Decides without I/O; belongs to one strand and has no mutex.
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
        /// When nobody of a lock's holder has been connected for so long, others may take it.
        std::int64_t lockTakeoverMs = 15 * 60'000;
        /// Layers that nobody has open stay in memory for so long, and all of them together
        /// take about so much.
        std::int64_t idleLayerMs = 60'000;
        std::size_t idleLayerBytes = 256ull << 20;
        /// A big value that nothing names is kept for so long (B6).
        std::int64_t keepUnusedBlobsMs = 15 * 60'000;
        std::optional<std::uint64_t> historyDays = {};  ///< older commits are replaced by a base
    };

    /// `head`: what the store says; `layers`: the files served and those with state in the store
    /// (all are listed, none is loaded); `namespaceChanges`: what the store says of the revisions
    /// after firstNamespaceRevision(), so that transactions of before the start still find their
    /// specs (M3).
    Project(Options options, ProjectHost& host, CommitStore::Head head, std::vector<LayerId> layers,
            std::vector<NamespaceChange> namespaceChanges);
    ~Project();

    /// What to ask CommitStore::namespaceChanges() for.
    [[nodiscard]] static Revision firstNamespaceRevision(const Options& options,
                                                         const CommitStore::Head& head) {
        return head.revision - std::min<Revision>(head.revision, options.namespaceLogRevisions);
    }

    // Sessions.
    void connected(SessionId session);
    /// One message as it came. Anything that is not the protocol is answered and the session
    /// closed.
    void received(SessionId session, ByteView message);
    void disconnected(SessionId session);
    /// It is no longer ProjectHost::congested().
    void drained(SessionId session);

    // Answers of the host.
    void appended(Revision upTo);
    /// Everything after the store's head is taken back: authors are told (refusals with `error`),
    /// the layers concerned are loaded anew, sessions go on. What was handed to append() before
    /// this call must not be appended after it. If `head` has a higher epoch, the store was
    /// opened anew.
    void appendFailed(Error error, CommitStore::Head head);
    /// An append has failed so that only a new opening of the store tells what is in it, as
    /// appendFailed() will. Until then nothing is asked of the store; new transactions are refused
    /// (SE8), and those that it may know wait.
    void storeClosed();
    void layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded);
    void snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes);
    void commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits);
    void historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc);
    void blobWritten(SessionId session, const Hash& hash, Result<bool> whole);
    void layersSaved(SessionId session, std::uint64_t request, SaveOutcome outcome);
    /// Of a save that takes long: it is at `layer`, after `done` of `total` layers (PG1).
    void layersBeingSaved(SessionId session, std::uint64_t request, const LayerId& layer,
                          std::size_t done, std::size_t total);
    /// loadLayer() found nothing in the store and reads the layer's file (PG1).
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
    void compacted(const Result<CompactOutcome>& outcome);
    void storageMeasured(SessionId session, std::uint64_t request, Result<Storage> storage);

    /// How the project's folder looks: to be told when that has changed. Layers that only the store
    /// has are among them.
    void setFiles(const std::vector<LayerFile>& files);

    /// To be called now and then, also while nothing happens.
    void unloadIdle();

    /// Tells everybody what changed in where the others are, and who is gone. To be called every
    /// kSweepMs while hasPresence(); `nowMs`: any steady clock.
    void sweep(std::int64_t nowMs);
    static constexpr std::int64_t kSweepMs = 1'000 / kPresencesPerSecond;
    [[nodiscard]] bool hasPresence() const;

    /// The clients that are connected, and those whose commits are not durable yet. The store must
    /// not forget them (M14): what they have sent and what is not answered may be committed
    /// already, and come once more.
    [[nodiscard]] std::set<ClientId> activeClients() const;

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

}  // namespace usdlive::server
