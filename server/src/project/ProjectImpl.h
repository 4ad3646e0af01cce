#pragma once

#include <deque>
#include <map>
#include <set>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <variant>
#include <vector>

#include "AccessPolicy.h"
#include "CommittedNumbers.h"
#include "KnownBlobs.h"
#include "NamespaceHistory.h"
#include "Previews.h"
#include "RecentCommits.h"
#include "UnusedBlobs.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/server/project/Project.h"

namespace usdlive::server {

// --- Sessions

/// Said nothing yet.
struct AwaitingHello {};
/// Wants to resume at a revision: what the client has committed, or the revision's hash, is being
/// read from the store. What it sends meanwhile waits.
struct CheckingResume {
    Hello hello;
    std::vector<Bytes> waiting;  ///< frames
    std::size_t waitingBytes = 0;
};
struct Greeted {};
/// Told to go, not gone yet.
struct Closing {};
using SessionPhase = std::variant<AwaitingHello, CheckingResume, Greeted, Closing>;

/// Gets every commit as it becomes durable.
struct Live {};
/// Gets commits of the past until it has reached the newest.
struct CatchingUp {};
/// Gets the commits [next, to] again; live ones wait until it has them.
struct SendingLog {
    std::uint64_t request = 0;
    Revision next = 0, to = 0;
};
using SessionStream = std::variant<Live, CatchingUp, SendingLog>;

/// What commits are read from the store for. One read of a session is under way at a time.
enum class ReadPurpose { ResumeCheck, Stream, Creations };
struct Read {
    ReadPurpose purpose{};
    Revision from = 0, to = 0;
    std::uint64_t sequence = 0;  ///< of Creations
};

struct QueuedTransaction {
    Transaction transaction;
    std::size_t bytes = 0;
    std::set<std::uint64_t> lookedUp;  ///< transactions whose creations were asked of the store
    std::set<Hash> soughtBlobs;        ///< big values that were asked of the store
};

/// A transaction that comes in parts (FR8).
struct ComingTransaction {
    SubmitParts parts;
    std::size_t bytes = 0;  ///< of the parts so far
    std::size_t edits = 0;
    bool refused = false;  ///< the parts that still come are passed over
};

/// A commit in parts on its way to a session, as far as the line takes it.
struct SendingParts {
    SharedBytes frame;
    std::size_t offset = 0;  ///< of the part that is next
};

/// To the author of a transaction; stays behind that author's earlier commits (SE5).
struct Answer {
    Revision after = 0;
    SharedBytes frame;
    bool repeats = false;  ///< says that a transaction is committed already, by `after`
    bool closing = false;
};

struct Session {
    SessionId id = 0;
    SessionPhase phase;
    ClientId client;
    Subject subject;
    std::string application;
    std::set<std::string> features;  ///< that both have
    std::set<LayerId> open;
    std::optional<Presence> presence;
    bool heard = false;        ///< of its presence, since the last sweep
    std::int64_t heardMs = 0;  ///< by then
    bool shown = true;         ///< everybody was told of its presence as it is
    bool uploads = false;      ///< big values, since the last look at unused ones
    bool greeted = false;      ///< it was, whatever its phase is now
    Revision greetedAt = 0;    ///< the newest durable commit then
    Revision position = 0;     ///< commits up to this one were sent
    bool ahead = false;        ///< it may have later ones (DD6)
    /// Layers were sent as of these revisions, at which what is conflated has to end (CF1).
    std::set<Revision> opened;
    SessionStream stream;
    std::deque<RequestLog> logs;  ///< asked for and not begun
    std::deque<Read> reads;
    std::deque<QueuedTransaction> transactions;
    std::size_t transactionBytes = 0;
    std::optional<ComingTransaction> coming;
    std::optional<SendingParts> sending;  ///< `stream` goes on behind it
    std::deque<Answer> answers;
    std::map<std::uint64_t, OpenLayer> historyReads;  ///< by request
    std::vector<RequestBlob> blobRequests;            ///< it is not known yet whether they are here
    /// By request: what is not handed on to be saved.
    std::map<std::uint64_t, std::vector<LayersSaved::Failure>> failedSaves;

    [[nodiscard]] bool isGreeted() const { return std::holds_alternative<Greeted>(phase); }
    [[nodiscard]] bool isLive() const {
        return isGreeted() && std::holds_alternative<Live>(stream);
    }
};

/// A client, over all its connections.
struct Author {
    OwnCreations creations;
    std::map<std::uint64_t, Revision> inFlight;  ///< by sequence: executed and not durable yet
    Revision newest = 0;                         ///< of its commits, as far as known
    std::optional<CommittedNumbers> committed;   ///< nothing: not known yet
    bool isRead = false;                         ///< the store is being asked for them
};

// --- Layers

struct WaitingOpen {
    SessionId session = 0;
    std::uint64_t request = 0;
};
struct NotLoaded {};
struct Loading {};
struct Loaded {};
struct LoadFailed {
    Error error;
};
/// A layer's file, as far as it is known.
struct EntryFile {
    LayerFile present;                ///< as the folder showed it last
    std::optional<FileTrace> looked;  ///< how it looked when its content was asked for last
    bool missing = false;             ///< it was there and is not any more
    bool outdated = false;            ///< it holds something else than was written or read last
};
/// What is known of a layer beside its content.
struct LayerEntry {
    std::variant<NotLoaded, Loading, Loaded, LoadFailed> state;
    std::vector<WaitingOpen> opens;          ///< until it is loaded
    Revision changed = 0;                    ///< by which commit since the start, 0 none
    std::size_t replayCost = 0;              ///< of its commits since a snapshot was taken
    std::size_t snapshotBytes = 0;           ///< of the last one that was kept
    bool takesSnapshot = false;              ///< one is on its way to the store
    std::optional<std::int64_t> snapshotMs;  ///< when the last one was taken
    SavedState saved;                        ///< as far as known
    bool unsaved = false;                    ///< differed from its file when the server started
    EntryFile file;
    LayerState told;         ///< as everybody was told last
    LayerLock lock;          ///< when it was unloaded, and as the log has it
    std::uint64_t idle = 0;  ///< its key in idle_, 0 none
};

/// A loaded layer that no session had open, at least when it was noted.
struct IdleLayer {
    LayerId layer;
    std::int64_t sinceMs = 0;
    std::size_t bytes = 0;  ///< that it takes in memory, about
};

/// A copy of a layer that is sent once everything in it is durable.
struct ReadyOpen {
    WaitingOpen open;
    LayerId layer;
    LayerDoc doc;
    Revision revision = 0;
};

/// A copy of a layer that the store keeps once everything in it is durable.
struct ReadySnapshot {
    LayerId layer;
    LayerDoc doc;
    Revision revision = 0;
    Hash hash;  ///< chain hash at the revision
};

struct SaveRequest {
    SessionId session = 0;
    std::uint64_t request = 0;
    bool force = false;
    std::set<LayerId> layers;
    std::vector<LayersSaved::Failure> failed;
};
struct ReadySave {
    SaveRequest save;
    std::vector<SaveJob> jobs;
    Revision revision = 0;
};

struct ReloadRequest {
    SessionId session = 0;
    std::uint64_t request = 0;
    std::set<LayerId> waiting;  ///< to be loaded
    struct Reading {
        Revision base = 0;  ///< the file is compared with the layer as it was then
        int attempt = 0;
    };
    std::map<LayerId, Reading> reading;
    /// Were found to be like their files, at the revision.
    std::vector<std::pair<LayerId, SavedState>> unchanged;
    LayersReloaded outcome;
};

/// For commits that are older to be replaced by a base.
struct CompactRequest {
    std::optional<SessionId> session;  ///< nothing: as the server was told when it started
    std::uint64_t request = 0;
    std::int64_t beforeMs = 0;
    // As it goes on:
    Revision from = 0;  ///< the base before
    std::string keptFor;
};

struct ReadyCheckpoint {
    SessionId session = 0;
    std::uint64_t request = 0;
    Checkpoint checkpoint;
};

// --- Commits

/// Executed and handed to the store, not durable yet.
struct InFlightCommit {
    Revision revision = 0;
    SharedBytes broadcast;
    Hash hash;
    TransactionId id;
    SessionId session = 0;  ///< that submitted it
    std::uint64_t gesture = 0;
    std::size_t edits = 0, dropped = 0;
    UserName user;
    std::set<LayerId> layers;
    std::set<LayerId> layerData;  ///< of them, whose custom layer data it changes
    std::vector<Hash> blobs;      ///< that it names
    std::optional<LayerId> imported;
    std::optional<CommitRecord::Saved> reloaded;
    std::uint64_t mark = 0;  ///< of the NamespaceLog before it
};

class Project::Impl : private AccessPolicy::Facts {
public:
    Impl(Options options, Ports ports, StoreState store, const std::vector<LayerFile>& files);

    // Sessions.cpp
    void connected(SessionId id);
    void received(SessionId id, ByteView message);
    void disconnected(SessionId id);
    void clientRead(const ClientId& client, const Result<ClientRecord>& record);
    [[nodiscard]] std::set<ClientId> activeClients() const;
    void clientsForgotten(Revision upTo) { forgottenUpTo_ = std::max(forgottenUpTo_, upTo); }

    // Stream.cpp
    void drained(SessionId id);
    void commitsRead(SessionId id, Result<std::vector<StoredCommit>> commits);

    // Commits.cpp
    void appended(Revision upTo);
    void appendFailed(const Error& error, const CommitStore::Head& head);
    void storeClosed() { storeClosed_ = true; }
    void setSpace(bool hasSpace) { hasSpace_ = hasSpace; }
    void snapshotKept(const LayerId& layer, const Result<std::size_t>& bytes);

    // LayerStates.cpp
    void tellStates();

    // Unloading.cpp
    void unloadIdle();

    // What the access policy decides by (LayerStates.cpp, Sessions.cpp)
    [[nodiscard]] const LayerDocs& loadedLayers() const override { return docs_; }
    [[nodiscard]] LayerLock lockAt(const LayerId& layer) const override;
    [[nodiscard]] bool isHere(const UserName& user) const override;
    [[nodiscard]] std::int64_t wallClockMs() const override { return ports_.clock.wallClockMs(); }

    // Presence.cpp
    void sweep(std::int64_t nowMs);
    [[nodiscard]] bool hasPresence() const { return presences_ > 0; }

    // Layers.cpp
    void layerLoaded(const LayerId& layer, Result<LoadedLayer> loaded);
    void layerNotStored(const LayerId& layer);
    void historyRead(SessionId id, std::uint64_t request, Result<LayerDoc> doc);
    void historyNotStored(SessionId id, std::uint64_t request);
    [[nodiscard]] std::vector<LayerInfo> layerInfos() const;

    // Blobs.cpp
    void blobsFound(const std::vector<Hash>& asked, const std::vector<Hash>& stored);
    void blobWritten(SessionId id, const Hash& hash, const Result<bool>& whole);
    [[nodiscard]] std::vector<Hash> unusedBlobs(const std::vector<Hash>& unnamed, Revision upTo,
                                                std::int64_t nowMs);

    void layerBeingImported(const LayerId& layer);

    // Files.cpp
    void layerCreated(SessionId id, std::uint64_t request, const LayerId& layer,
                      const Result<void>& created);
    void skippedListed(SessionId id, std::uint64_t request,
                       Result<std::vector<SkippedFile>> skipped);
    void setFiles(const std::vector<LayerFile>& files);
    void fileChecked(const LayerId& layer, const Result<std::optional<FileStamp>>& file);

    // Saves.cpp
    void layersSaved(SessionId id, std::uint64_t request, const SaveOutcome& outcome);
    void layersBeingSaved(SessionId id, std::uint64_t request, const LayerId& layer,
                          std::size_t done, std::size_t total);

    // Reloads.cpp
    void layerReloaded(SessionId id, std::uint64_t request, const LayerId& layer,
                       Result<ReloadedLayer> reloaded);

    // Checkpoints.cpp
    void checkpointAdded(SessionId id, std::uint64_t request, const Result<Checkpoint>& added);
    void checkpointsRead(SessionId id, std::uint64_t request, Result<std::vector<Checkpoint>> read);

    // History.cpp
    void boundHistory();
    void baseFound(Result<BaseLimit> limit);
    void baseIs(const CommitStore::Base& base);
    void compacted(const Result<CompactOutcome>& outcome);
    void storageMeasured(SessionId id, std::uint64_t request, Result<Storage> storage);

    [[nodiscard]] Revision durableRevision() const { return durable_; }
    [[nodiscard]] const ProjectCounters& counters() const { return counters_; }
    [[nodiscard]] std::size_t sessionCount() const { return sessions_.size(); }
    [[nodiscard]] const LayerDoc* layer(const LayerId& layer) const;

private:
    // Sessions.cpp: what arrives and who sent it.
    Session* find(SessionId id);
    void receiveFrame(Session& session, ByteView frame);
    void receiveControl(Session& session, const std::string& json);
    void receive(Session& session, const ControlMessage& message);
    void greet(Session& session, const Hello& hello);
    void checkResume(Session& session);
    void readClient(const ClientId& client);
    void resumeChecked(Session& session, const Result<Hash>& hash);
    void welcome(Session& session, std::optional<Error> whyNotResumed);
    void send(Session& session, const ControlMessage& message);
    void tellAll(const std::string& feature, const News& news);
    void sendError(Session& session, const Error& error, std::optional<std::uint64_t> request = {},
                   std::optional<Hash> blob = {});
    void supersede(const ClientId& client);
    void close(Session& session, const Error& error);
    [[nodiscard]] bool isConnected(const ClientId& client) const;
    void forgetAuthor(const ClientId& client);

    // Stream.cpp: commits of the past, until a session has caught up.
    void pump(Session& session);
    void sendPast(Session& session, const SharedBytes& frame);
    void sendPart(Session& session);
    void wasSent(Session& session);
    [[nodiscard]] SharedBytes largeCommit(Revision revision);
    bool sendRecent(Session& session, Revision last);
    void sendRun(Session& session, const std::vector<StoredCommit>& commits);
    [[nodiscard]] static std::optional<CommitFrame> conflatable(const Session& session,
                                                                const StoredCommit& stored);
    void requestRead(Session& session, Read read);
    void streamRead(Session& session, Result<std::vector<StoredCommit>> commits);
    void requestLog(Session& session, const RequestLog& request);
    void beginLog(Session& session);
    void endLog(Session& session);
    void becomeLive(Session& session);
    void releaseAnswers(Session& session);
    [[nodiscard]] std::optional<Hash> knownHash(Revision revision) const;

    // Transactions.cpp: what authors submit, until it is executed.
    void receiveSubmit(Session& session, SubmitFrame frame, std::size_t bytes);
    [[nodiscard]] std::optional<Refused> partObjection(const ComingTransaction& coming) const;
    void forgetComing(Session& session);
    void submit(Session& session, Transaction transaction, std::size_t bytes);
    void work(Session& session);
    bool workOff(Session& session, QueuedTransaction& queued);
    [[nodiscard]] static std::optional<Revision> committed(const Author& author,
                                                           std::uint64_t sequence);
    [[nodiscard]] std::optional<Refused> objection(const Author& author,
                                                   const QueuedTransaction& queued) const;
    std::variant<bool, Refused> blobsReady(QueuedTransaction& queued);
    [[nodiscard]] std::size_t expandedBytes(const Author& author,
                                            const Transaction& transaction) const;
    std::variant<bool, Refused> layersReady(const Transaction& transaction);
    bool creationsKnown(Session& session, Author& author, QueuedTransaction& queued);
    void learnCreations(Author& author, std::uint64_t sequence, const StoredCommit& stored);
    void execute(Session& session, Author& author, const QueuedTransaction& queued);
    void refuse(Session& session, const Transaction& transaction, const Refused& refused);
    void answer(Session& session, Answer answer);

    // Commits.cpp: what was executed, until it is durable and told.
    [[nodiscard]] std::optional<std::pair<InFlightCommit, CommitRecord>> makeCommit(
        const UserName& user, const TransactionId& id, std::uint64_t gesture, Executed executed,
        std::uint64_t mark);
    bool commit(Session& session, Author& author, const Transaction& transaction, Executed executed,
                std::uint64_t mark);
    [[nodiscard]] SharedBytes encodeCommit(const Commit& commit) const;
    void append(InFlightCommit commit, CommitRecord record);
    void takeSnapshot(const LayerId& layer);
    void keepSnapshots();
    void commitDurable(const InFlightCommit& commit);
    void noteLock(const UserName& user, const LayerId& layer);
    void broadcast(const InFlightCommit& commit);
    void broadcastInParts(const InFlightCommit& commit);
    void settle();
    void takeBack(const Error& error, const std::vector<InFlightCommit>& lost);
    void refuseLost(Session& session, const Error& error, const std::vector<InFlightCommit>& lost);
    void reloadLost(const Error& error, const std::vector<InFlightCommit>& lost);

    // Layers.cpp
    void openLayer(Session& session, const OpenLayer& open);
    void openHistory(Session& session, const OpenLayer& open);
    void openLoaded(const WaitingOpen& open, const LayerId& layer);
    void sendOpened(const ReadyOpen& ready);
    void load(const LayerId& layer);
    void loadFailed(const LayerId& layer, const Error& error);
    Result<void> import(const LayerId& layer, LayerImport import);
    void workAll();

    // Unloading.cpp
    void noteIdle(const LayerId& layer);
    [[nodiscard]] std::set<LayerId> lockingStacks() const;
    [[nodiscard]] bool isOpen(const LayerId& layer) const;
    [[nodiscard]] bool isNeeded(const LayerId& layer, const LayerEntry& entry) const;

    // Blobs.cpp
    void requestBlob(Session& session, const RequestBlob& request);
    void findBlobs(std::vector<Hash> hashes);
    void answerRequest(Session& session, const RequestBlob& request);
    void receiveBlob(Session& session, BlobFrame part);
    void sendStored(Session& session, const Hash& hash);
    [[nodiscard]] bool handlesFiles() const;
    [[nodiscard]] std::unordered_set<Hash> namedHere() const;

    // LayerStates.cpp
    void tellStatesTo(Session& session);
    [[nodiscard]] LayerState stateOf(const LayerId& layer, const LayerEntry& entry) const;
    [[nodiscard]] std::set<LayerId> mutedLayers() const;
    [[nodiscard]] std::set<LayerId> mutedBy(const LayerId& root) const;
    void noteMutes(const LayerId& layer);
    void closeLayer(Session& session, const LayerId& layer);

    // Presence.cpp
    void showPresence(Session& session, Presence presence);
    void tellPresencesTo(Session& session);
    void presenceLeft(const ClientId& client);

    // Saves.cpp
    void saveLayers(Session& session, const SaveLayers& request);
    void continueSaves();
    bool continueSave(SaveRequest& save);
    void leaveLocked(const Session& session, SaveRequest& save) const;
    void sendSave(const ReadySave& ready);

    // Files.cpp
    void createLayer(Session& session, const CreateLayer& request);
    void tellLayers();
    void checkFile(const LayerId& layer, LayerEntry& entry);
    void fileWas(const LayerId& layer, const SavedState& saved);
    void fileIs(const LayerId& layer, const SavedState& saved);

    // Reloads.cpp
    void reloadLayers(Session& session, const ReloadLayers& request);
    void continueReloads();
    void continueReload(ReloadRequest& reload);
    void read(ReloadRequest& reload, const LayerId& layer, int attempt);
    Result<void> takeFile(const Session& session, const LayerId& layer, ReloadedLayer reloaded);
    void sendReloaded(const ReloadRequest& reload);

    // Checkpoints.cpp
    void createCheckpoint(Session& session, const CreateCheckpoint& request);
    void storeCheckpoints();
    void loseCheckpoints(const Error& error);

    // History.cpp
    void compactHistory(Session& session, const CompactHistory& request);
    void compactNext();
    void compactDone(const Result<CompactOutcome>& outcome);
    [[nodiscard]] Revision oldestNeeded() const;

    // Gestures.cpp
    void receivePreview(Session& session, PreviewFrame preview, std::size_t bytes);
    void withdraw(const ClientId& author, std::uint64_t gesture);
    void withdrawAll(const ClientId& author);

    Options options_;
    Ports ports_;
    Epoch epoch_;
    bool hasSpace_;  ///< in the store
    ProjectCounters counters_;

    std::map<SessionId, Session> sessions_;
    std::uint64_t comingBytes_ = 0;  ///< of all sessions' transactions that come in parts
    std::unordered_map<ClientId, Author> authors_;

    LayerDocs docs_;  ///< as executed, ahead of what is durable
    std::map<LayerId, LayerEntry> layers_;
    std::map<LayerId, std::set<LayerId>> mutes_;  ///< by root layer, for everybody (MU1)
    std::map<std::uint64_t, IdleLayer> idle_;     ///< by when they were noted
    std::uint64_t lastIdle_ = 0;
    std::size_t idleBytes_ = 0;   ///< of all of them
    std::set<LayerId> suspects_;  ///< whose state may be other than everybody was told
    AccessPolicy access_;
    std::size_t presences_ = 0;  ///< sessions that show where they are
    std::vector<SaveRequest> saves_;
    std::size_t savesUnderWay_ = 0;  ///< that have been begun
    std::vector<ReloadRequest> reloads_;

    NamespaceHistory history_;
    const Revision firstRevision_;  ///< of the store when this began
    Revision executed_;
    Hash executedHash_;
    std::deque<InFlightCommit> inFlight_;
    bool storeClosed_ = false;

    Revision durable_;
    Hash durableHash_;
    RecentCommits recent_;
    CommitStore::Base base_;
    Revision oldest_;         ///< that may be read: a base that is being made, or base_
    Revision forgottenUpTo_;  ///< as the store said last (M14)
    std::deque<CompactRequest> compacts_;  ///< the first is under way
    /// Commits in parts while some session is sent them: one copy for all.
    std::map<Revision, std::weak_ptr<const Bytes>> large_;
    /// The newest commit in parts that this process has met, for who cannot read it.
    Revision newestInParts_ = 0;
    // By revision:
    std::deque<ReadyOpen> readyOpens_;
    std::deque<ReadySnapshot> readySnapshots_;
    std::deque<ReadySave> readySaves_;
    std::deque<ReloadRequest> readyReloads_;
    std::deque<ReadyCheckpoint> readyCheckpoints_;

    Previews previews_;
    KnownBlobs knownBlobs_;
    UnusedBlobs unusedBlobs_;
};

}  // namespace usdlive::server
