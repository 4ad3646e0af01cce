// One project: the logic that orders and checks edits, and its interface to the process around it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "project/CommitStore.h"
#include "project/PublicText.h"
#include "project/Subject.h"
#include "project/ports/Ports.h"
#include "usdlive/common/access/AccessRules.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

/// The newest revision up to which the history may be replaced by a base.
struct BaseLimit {
    Revision revision = 0;
    /// The reason why newer commits of sufficient age are kept; empty: there are none.
    std::string keptFor;
};
/// Returns the time of a commit that the store has, in milliseconds since 1970.
[[nodiscard]] Result<std::int64_t> timeOf(const CommitStore& store, Revision revision);
/// Returns the last commit that was made before `beforeMs` (milliseconds since 1970), but no later
/// one than `upTo` or the oldest checkpoint. Takes long; any thread.
[[nodiscard]] Result<BaseLimit> findBase(const CommitStore& store, std::int64_t beforeMs,
                                         Revision upTo);
/// The result of ports::History::compact().
struct CompactOutcome {
    std::uint64_t bytesBefore = 0, bytesAfter = 0;  ///< sizes of the log
};

/// The commit that imports a whole layer from its file, before it has a revision.
struct LayerImport {
    ImportFrame frame;        ///< stampCommit() adds the revision and the hash of the commit before
    std::vector<Hash> blobs;  ///< the big values that it names
};
/// Encodes the import of a layer. Takes long; any thread. Error: LayerUnreadable (too large for one
/// commit).
[[nodiscard]] Result<LayerImport> makeImport(const LayerId& layer, const LayerDoc& doc);

/// The result of ports::History::loadLayer() or ports::Files::importLayer().
struct LoadedLayer {
    LayerDoc doc;
    std::optional<LayerImport> import = std::nullopt;  ///< set if it was read from its file
    SavedState saved = {};   ///< for an import: `revision` is 0, `file` is the file that was read
    Replayed replayed = {};  ///< the cost of loading it from the store
};

/// The difference between a layer and its file.
struct ReloadedLayer {
    /// The edits that turn the layer into the content of the file, in order, with absolute paths.
    std::vector<Edit> edits;
    LayerDoc doc;  ///< the file's content, with the node ids of `present`
    FileStamp file;
};
/// Compares `present`, the layer, with `content`, its file. Treats specs of the same path and kind
/// as the same spec. Takes long; any thread.
[[nodiscard]] ReloadedLayer makeReload(const LayerId& layer, const LayerDoc& present,
                                       const LayerDoc& content, const FileStamp& file);

/// The results of all SaveJobs of a request.
struct SaveOutcome {
    Revision revision = 0;  ///< the highest revision of the jobs
    std::vector<std::pair<LayerId, FileStamp>> saved;
    std::vector<LayersSaved::Failure> failed;
};

/// The state of the store when a project is created over it.
struct StoreState {
    CommitStore::Head head;
    CommitStore::Base base = {};
    /// The moves and deletes after Project::firstNamespaceRevision(), so that transactions that
    /// were sent before the start still find their specs (M3).
    std::vector<NamespaceChange> namespaceChanges = {};
    std::vector<LayerId> unsaved = {};  ///< CommitStore::unsavedLayers()
    Revision forgottenUpTo = 0;         ///< CommitStore::forgottenUpTo()
    bool hasSpace = true;               ///< CommitStore::hasSpace()
    StoreId identity = {};              ///< CommitStore::identity()
    std::int64_t headTimeMs = 0;        ///< time of the newest commit; 0: there is none
};

/// Counters for /metrics. All count from the start of the project.
struct ProjectCounters {
    std::uint64_t commits = 0, edits = 0, dropped = 0, refused = 0, previews = 0, duplicates = 0;
    std::uint64_t delivered = 0;  ///< commit frames that were sent to sessions
    std::uint64_t unloaded = 0;   ///< layers that were removed from memory
};

/// The authority over one project. Accepts sessions, orders and executes their transactions, and
/// sends the commits to all sessions. Does no I/O: it calls the ports, and their answers are passed
/// to it. Belongs to one strand: all functions but static ones are called there, one after the
/// other.
class Project {
public:
    struct Options {
        std::string name;
        PublicText texts = {};  ///< filters errors for clients
        std::size_t maxFrameBytes = kMaxFrameBytes;
        std::uint64_t maxBlobBytes = 4ull << 30;
        std::size_t maxEditsPerTransaction = kMaxTransactionEdits;
        std::uint64_t maxTransactionBytes = kMaxTransactionBytes;  ///< limit of one in parts (FR8)
        /// Commits that are larger than this, or than a frame, are sent in parts of about
        /// `partBytes`.
        std::size_t wholeCommitBytes = kMaxFrameBytes;
        std::size_t partBytes = kPartBytes;
        std::size_t maxSessions = 1'000;
        std::size_t maxUserSessions = 100;  ///< the limit for a signed-in user (AC10)
        /// The limit of layers that the sessions of one user have open together (SE22).
        std::size_t maxUserLayers = 100'000;
        /// Memory of requests that are not answered yet: of one session, of those of a user, and of
        /// all together.
        std::size_t sessionRequestBytes = 64ull << 20, userRequestBytes = 128ull << 20,
                    requestBytes = 512ull << 20;
        std::size_t recentCommitBytes = 64ull << 20;  ///< commits in memory, for resuming sessions
        /// The most revisions that a transaction's base may be old.
        std::size_t namespaceLogRevisions = kNamespaceLogRevisions;
        Revision maxBehind = 100'000;  ///< a session that lacks more commits than this is closed
        std::size_t leastReplay = kLeastReplay;  ///< see snapshotDue()
        /// The shortest time between two snapshots of a layer.
        std::int64_t snapshotIntervalMs = 10'000;
        std::set<UserName> administrators = {};  ///< may edit and unlock what others have locked
        /// The time after which others may take a lock whose holder is not connected.
        std::int64_t lockTakeoverMs = 15 * 60'000;
        /// The time for which layers that no session has open stay in memory, and the memory that
        /// all of them may use, about.
        std::int64_t idleLayerMs = 60'000;
        std::size_t idleLayerBytes = 256ull << 20;
        /// The time for which a big value that nothing names is kept (B6).
        std::int64_t keepUnusedBlobsMs = 15 * 60'000;
        bool reloadsFiles = false;  ///< reloads changed files without unsaved edits (FI8)
        std::optional<std::uint64_t> historyDays = {};  ///< older commits are replaced by a base
    };

    /// `files` lists all served layers, including those that only the store has. Loads none of
    /// them.
    Project(Options options, Ports ports, StoreState store, const std::vector<LayerFile>& files);
    ~Project();

    /// The revision to pass to CommitStore::namespaceChanges().
    [[nodiscard]] static Revision firstNamespaceRevision(const Options& options,
                                                         const CommitStore::Head& head) {
        return head.revision - std::min<Revision>(head.revision, options.namespaceLogRevisions);
    }

    // ---- Sessions.

    /// Adds a session. Call it when a connection has opened. `user`: whoever signed in, or nothing
    /// if the server does not ask users to. `address`: of the other end of the connection, empty if
    /// the transport knows none.
    void connected(SessionId session, std::optional<SignedIn> user = {},
                   const std::string& address = {});
    /// Ends the sessions of signed-in users whose role is not the one that `roleOf` returns. Those
    /// who may still read connect again and are told their new role.
    void rolesChanged(const std::function<Role(const SignedIn&)>& roleOf);
    /// AC23: ends the sessions of users whose sign-in has ended at `now`, in seconds since 1970.
    /// Returns whether there are sessions whose sign-in will end.
    bool endSignIns(std::int64_t now);
    /// Receives one message. Closes the session with an error if the message violates the protocol.
    void received(SessionId session, ByteView message);
    /// Removes a session. Call it when the connection has ended, whoever closed it.
    void disconnected(SessionId session);
    /// Call it when a session is no longer ports::Outbox::congested() or lags().
    void drained(SessionId session);

    /// Replaces the access rules (AC6).
    void setRules(std::shared_ptr<const AccessRules> rules);

    // ---- Answers of the ports. `session` and `request` are those of the request.

    /// The commits up to this revision are durable.
    void appended(Revision upTo);
    /// Rolls back all commits after the store's `head`: their authors receive refusals with
    /// `error`, the layers concerned are loaded again, and sessions continue. Commits that were
    /// passed to append() before this call must not be appended after it. A higher epoch of `head`
    /// means that the store was opened again.
    void appendFailed(Error error, CommitStore::Head head);
    /// An append has failed, and the store's content is unknown until it is opened again. Call
    /// appendFailed() then. Until then the project requests nothing from the store and refuses new
    /// transactions (SE8); repeated transactions that the store may contain wait.
    void storeClosed();
    void layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded);
    /// The store has no commit of the layer. The project imports the layer's file.
    void layerNotStored(const LayerId& layer);
    void snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes);
    void commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits);
    void historyRead(SessionId session, std::uint64_t request, Result<LayerDoc> doc);
    /// The store has no commit of the layer. The project reads the layer's file.
    void historyNotStored(SessionId session, std::uint64_t request);
    void clientRead(const ClientId& client, const Result<ClientRecord>& record);
    /// `stored` contains the values of `asked` that are stored.
    void blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored);
    void blobWritten(SessionId session, const Hash& hash, Result<bool> whole);
    void layersSaved(SessionId session, std::uint64_t request, SaveOutcome outcome);
    /// A long save has begun to write `layer`, after `done` of `total` layers (PG1).
    void layersBeingSaved(SessionId session, std::uint64_t request, const LayerId& layer,
                          std::size_t done, std::size_t total);
    /// The import has begun to read the layer's file (PG1).
    void layerBeingImported(const LayerId& layer);
    void layerCreated(SessionId session, std::uint64_t request, const LayerId& layer,
                      const Result<void>& created);
    /// `complete`: the file has the content; false: the store does not have the content.
    void fileStored(SessionId session, std::uint64_t request, const std::string& path,
                    const Result<bool>& complete);
    void skippedListed(SessionId session, std::uint64_t request,
                       Result<std::vector<SkippedFile>> skipped);
    void fileChecked(const LayerId& layer, Result<std::optional<FileStamp>> file);
    void layerReloaded(SessionId session, std::uint64_t request, const LayerId& layer,
                       Result<ReloadedLayer> reloaded);

    void checkpointAdded(SessionId session, std::uint64_t request, const Result<Checkpoint>& added);
    void checkpointsRead(SessionId session, std::uint64_t request,
                         Result<std::vector<Checkpoint>> checkpoints);

    /// Starts to replace the commits that are older than Options::historyDays, if it is set. Call
    /// it regularly, for example every hour.
    void boundHistory();
    void baseFound(Result<BaseLimit> limit);
    /// CommitStore::base() has changed to this.
    void baseChanged(const CommitStore::Base& base);
    void compacted(const Result<CompactOutcome>& outcome);
    void storageMeasured(SessionId session, std::uint64_t request, Result<Storage> storage);

    // ---- Changes outside, and work that is due.

    /// Call it when CommitStore::hasSpace() has changed. Edits are refused with StorageFull while
    /// it is false (SE8).
    void setSpace(bool hasSpace);

    /// Call it when the project's folder has changed. `files` lists all served layers, including
    /// those that only the store has.
    void setFiles(const std::vector<LayerFile>& files);

    /// Removes layers from memory that no session uses. Call it regularly, for example every
    /// second.
    void unloadIdle();

    /// Sends the changed and the expired presences to all sessions. Call it every kSweepMs while
    /// hasPresence(). `nowMs` is the time of any steady clock, in milliseconds.
    void sweep(std::int64_t nowMs);
    static constexpr std::int64_t kSweepMs = 1'000 / kPresencesPerSecond;
    [[nodiscard]] bool hasPresence() const;

    /// Returns the clients that are connected or whose commits are not durable yet. The store must
    /// not forget them (M14): they may repeat a transaction that is already committed, but not
    /// acknowledged.
    [[nodiscard]] std::set<ClientId> activeClients() const;
    /// CommitStore::forgottenUpTo() has changed to this.
    void clientsForgotten(Revision upTo);

    /// Returns the big values to drop (B6). `unnamed` are the stored values that no commit up to
    /// `upTo` names. The result contains those that the project does not name either, and that were
    /// unused for Options::keepUnusedBlobsMs, by `nowMs` of any steady clock. The caller must pass
    /// them to BlobStore::drop() before it calls another function. Call it regularly, also with an
    /// empty `unnamed`, so that the project deletes its notes.
    [[nodiscard]] std::vector<Hash> unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                                std::int64_t nowMs);

    // ---- State.

    [[nodiscard]] Revision durableRevision() const;
    [[nodiscard]] const ProjectCounters& counters() const;
    [[nodiscard]] std::size_t sessionCount() const;
    /// Returns the users of the sessions that sessionCount() counts.
    [[nodiscard]] std::set<UserName> users() const;
    /// Returns whose session it is; nullptr before its hello, and for an unknown session.
    [[nodiscard]] const Subject* subjectOf(SessionId session) const;
    /// Returns a loaded layer with all executed commits, durable or not; nullptr if it is not
    /// loaded.
    [[nodiscard]] const LayerDoc* layer(const LayerId& layer) const;

private:
    class Impl;
    std::unique_ptr<Impl> impl_;
};

/// Reads the StoreState for a new Project. Takes long; any thread.
[[nodiscard]] Result<StoreState> readState(const CommitStore& store,
                                           const Project::Options& options);

}  // namespace usdlive::server
