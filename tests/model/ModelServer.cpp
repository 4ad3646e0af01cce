// The real Project with a simulated process and disk, as a machine of the model.
#include "ModelServer.h"

#include "project/ProjectImpl.h"
#include "simulation/SimClock.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::model {

using namespace server;
using simulation::require;

static const tl::unexpected<Error> kClosed = fail(ErrorCode::StorageFailed, "the store is closed");

static void digest(Digest& out, const CheckingResume& part) {
    const auto& [hello, waiting, waitingBytes] = part;
    out(encodeControl(hello), waiting, waitingBytes);
}
static void digest(Digest& out, const Subject& part) { out(part.user, std::uint64_t(part.role)); }
static void digest(Digest& out, const server::Session& part) {
    const auto& [id, phase, client, subject, share, application, features, open, compact,
                 wasGreeted] = part;
    // Features are the same for all; compact frames are not among them.
    out(id, phase, client, subject, open);
}
static void digest(Digest& out, const StoreCondition& part) { out(part.closed); }

// The content of a line of history and its layers.
static void digest(Digest& out, const OrderedCommit& part) {
    const auto& [revision, broadcast, content, acceptance, hash, id, user, gesture, edits, dropped,
                 frameBytes, layers, layerData, blobs, imported, mark] = part;
    out(revision, hash, id, gesture, layers, imported, mark);  // the others follow
}
static void digest(Digest& out, const HistoryLine& part) {
    out(part.docs_, part.namespaces_, part.epoch_, part.executed_, part.executedHash_,
        part.inFlight_, part.durable_, part.durableHash_);
}
static void digest(Digest& out, const LoadFailed& part) { out(part.error); }
static void digest(Digest& out, const LayerTable::Entry& part) {
    const auto& [loading, changed] = part;
    out(loading, changed);
}
static void digest(Digest& out, const LayerTable& part) { out(part.layers_); }
static void digest(Digest& out, const FileStates::Entry& part) {
    const auto& [saved, unsaved, present, looked, missing, outdated] = part;
    out(saved.revision, unsaved);  // no files here
}
static void digest(Digest& out, const FileStates& part) { out(part.entries_); }
static void digest(Digest& out, const LayerState& part) { out(encodeControl(LayerStates{{part}})); }
static void digest(Digest& out, const StateBoard& part) { out(part.sent_); }

// The messages to sessions, and their submitted transactions.
static void digest(Digest& out, const RequestLog& part) { out(encodeControl(part)); }
static void digest(Digest& out, const CommitRead& part) {
    const auto& [purpose, from, to, sequence] = part;
    out(purpose, from, to, sequence);
}
static void digest(Digest& out, const CommitReads& part) { out(part.reads_); }
static void digest(Digest& out, const SendingLog& part) {
    const auto& [request, next, to] = part;
    out(request, next, to);
}
static void digest(Digest& out, const Answer& part) {
    const auto& [after, frame, repeats, closes] = part;
    out(after, frame, repeats, closes);
}
static void digest(Digest& out, const Answers& part) { out(part.waiting_); }
static void digest(Digest& out, const RecentCommits& part) {
    // From the oldest entry on, they equal those of the log.
    out(part.entries_.size(), part.entries_.empty() ? Revision(0) : part.entries_.front().revision);
}
static void digest(Digest& out, const Catchup::Stream& part) {
    const auto& [id, client, conflates, readsCompact, isClosing, state, greetedAt, position,
                 isAhead, opened, submitted, names, logs, sending, answers] = part;
    // Nothing is so large that it goes in parts.
    out(isClosing, state, greetedAt, position, opened, logs, answers);
}
static void digest(Digest& out, const Catchup& part) { out(part.recent_, part.streams_); }
static void digest(Digest& out, const Openings::Request& part) {
    const auto& [session, request] = part;
    out(session, request);
}
static void digest(Digest& out, const Openings::Snapshot& part) {
    const auto& [request, layer, doc, revision] = part;
    out(request, layer, doc, revision);
}
static void digest(Digest& out, const Openings& part) {
    out(part.waiting_, part.pending_);  // no client opens a layer as it was
}
static void digest(Digest& out, const Author& part) {
    const auto& [creations, inFlight, newest, committed, isBeingRead] = part;
    // The store says which are committed.
    out(creations, inFlight, newest, committed.has_value(), isBeingRead);
}
static void digest(Digest& out, const Authors& part) { out(part.authors_); }
static void digest(Digest& out, const QueuedTransaction& part) {
    const auto& [transaction, bytes, lookedUp, soughtBlobs] = part;
    out(transaction, bytes, lookedUp);
}
static void digest(Digest& out, const Submissions::Queue& part) {
    const auto& [transactions, bytes, held] = part;
    out(transactions, bytes, held ? held->sequences : std::set<std::uint64_t>(),
        held ? held->reason : Error{});
}
static void digest(Digest& out, const LostSubmission& part) {
    const auto& [revision, sequence, session] = part;
    out(revision, sequence, session);
}
static void digest(Digest& out, const Submissions& part) {
    // A session that has submitted nothing is like one whose transactions are all ordered.
    std::map<SessionId, Submissions::Queue> queues = part.queues_;
    std::erase_if(queues, [](const auto& one) {
        return one.second.transactions.empty() && !one.second.held;
    });
    out(queues, part.inFlight_);
}

// Left out are parts without a state that decides what comes, and what no client of the model uses:
// previews, presence, big values, saves, reloads, checkpoints and compaction. When a snapshot is
// taken makes no difference.
static void digest(Digest& out, const Project::Impl& part) {
    out(part.store_, part.line_, part.sessions_.sessions_, part.suspects_, part.layers_,
        part.fileStates_, part.states_, part.reads_, part.catchup_, part.openings_, part.authors_,
        part.submissions_);
}

void digest(Digest& out, const ModelServer::ReadCommits& part) {
    out(part.session, part.from, part.to);
}
void digest(Digest& out, const ModelServer::ReadClient& part) { out(part.client); }
void digest(Digest& out, const ModelServer::SendSnapshot& part) {
    out(part.session, part.request, part.doc);
}

// ---- the durable history

const History& Archive::of(const CommitStore& store) {
    const Hash newest = store.head().hash;
    if (const auto known = histories_.find(newest); known != histories_.end()) return known->second;
    History history;
    LayerDocs docs{{kLayer, {}}};
    NamespaceLog log;
    Labels labels = 0;
    std::set<TransactionId> seen;
    const auto note = [&](const Hash& hash) {
        history.hashes.push_back(hash);
        history.contents.push_back(sha256(asBytes(docs.at(kLayer).dump())));
        history.committed.push_back(labels);
    };
    note({});
    (void)store.read(1, store.head().revision, [&](const StoredCommit& stored) {
        const auto frame = decodeFrame(splitMessage(*stored.frame)->front());
        const Commit& commit = std::get<CommitFrame>(*frame).commit;
        require(applyCommit(docs, log, commit).has_value(), "a stored commit does not apply");
        require(commit.imported || seen.insert(commit.id).second,
                "a transaction is committed twice (M9)");
        for (const Edit& edit : commit.edits) {
            const auto label = commit.imported ? std::nullopt : labelOf(edit.action);
            require(!label || !(labels & 1u << *label), "an edit is committed twice");
            if (label) labels |= 1u << *label;
        }
        note(stored.hash);
        return true;
    });
    return histories_.emplace(newest, std::move(history)).first->second;
}

// ---- the process

/// Serves the copy that is working at the moment.
class ModelServer::Host : public AllPorts {
public:
    ModelServer* now = nullptr;

    void send(SessionId session, SharedBytes frames) override {
        now->outputs_.push_back(
            {std::uint8_t(session), false, now->messages_.number(std::move(frames))});
    }
    void close(SessionId session) override {
        now->outputs_.push_back({std::uint8_t(session), true, 0});
    }
    void append(CommitRecord commit) override {
        requireOpen();
        now->appends_.push_back(std::move(commit));
    }
    void loadLayer(const LayerId&) override { now->jobs_.push_back(LoadLayer{}); }
    void readCommits(SessionId session, Revision from, Revision to) override {
        now->jobs_.push_back(ReadCommits{session, from, to});
    }
    void sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) override {
        now->jobs_.push_back(SendSnapshot{session, request, std::move(doc)});
    }
    void readClient(const ClientId& client) override { now->jobs_.push_back(ReadClient{client}); }
    void sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) override {
        for (const SessionId session : sessions) sendInitialState(session, update);
    }
    void sendInitialState(SessionId session, const StateUpdate& all) override {
        if (SharedBytes frame = encodeStateUpdate(all)) send(session, std::move(frame));
    }
    void sendCommit(std::span<const SessionId> sessions, SharedBytes frame, Revision) override {
        for (const SessionId session : sessions) send(session, frame);
    }
    bool holdCommits(SessionId) override { return false; }
    void releaseCommits(SessionId, Revision) override {}
    bool congested(SessionId) override { return false; }
    bool lags(SessionId) override { return false; }
    std::int64_t wallClockMs() override { return 0; }
    std::int64_t steadyMs() override { return 0; }
    void keepSnapshot(const LayerId&, LayerDoc, Revision, const Hash&) override {}
    void record(const ActivityEvent&) override {}  // the project's log entries are not tested

    void importLayer(const LayerId&) override { notModelled(); }
    void readLayer(SessionId, std::uint64_t, const LayerId&) override { notModelled(); }
    void readHistory(SessionId, std::uint64_t, const LayerId&, Revision) override { notModelled(); }
    void setSaved(const LayerId&, const SavedState&) override { notModelled(); }
    void addCheckpoint(SessionId, std::uint64_t, const Checkpoint&) override { notModelled(); }
    void readCheckpoints(SessionId, std::uint64_t) override { notModelled(); }
    void findBase(std::int64_t, Revision) override { notModelled(); }
    void compact(Revision) override { notModelled(); }
    void measureStorage(SessionId, std::uint64_t) override { notModelled(); }
    void sendBeside(SessionId, std::vector<SharedBytes>) override { notModelled(); }
    void findBlobs(std::vector<Hash>) override { notModelled(); }
    void sendBlob(SessionId, const Hash&, std::uint64_t) override { notModelled(); }
    void writeBlob(SessionId, const std::string&, BlobFrame) override { notModelled(); }
    void removeUnfinished(SessionId) override { notModelled(); }
    void saveLayers(SessionId, std::uint64_t, std::vector<SaveJob>) override { notModelled(); }
    void checkFile(const LayerId&) override { notModelled(); }
    void reloadLayer(SessionId, std::uint64_t, const LayerId&, LayerDoc) override { notModelled(); }
    void createLayerFile(SessionId, std::uint64_t, const LayerId&) override { notModelled(); }
    void storeFile(SessionId, std::uint64_t, UploadJob) override { notModelled(); }
    void listSkipped(SessionId, std::uint64_t) override { notModelled(); }

private:
    void requireOpen() const { require(!now->disk_->failed, "the project uses a closed store"); }
    static void notModelled() { throw std::logic_error("no client of the model requests this"); }
};

ModelServer::ModelServer(const Scenario& scenario, Messages& messages, Archive& archive)
    : scenario_(scenario),
      messages_(messages),
      archive_(archive),
      disk_(std::make_shared<simulation::SimDisk>()),
      host_(std::make_shared<Host>()) {
    start();
}

ModelServer::ModelServer(const ModelServer& other)
    : scenario_(other.scenario_),
      messages_(other.messages_),
      archive_(other.archive_),
      disk_(other.disk_),
      appends_(other.appends_),
      reported_(other.reported_),
      jobs_(other.jobs_),
      host_(other.host_),
      project_(newProject({})) {
    *project_ = *other.project_;
}

ModelServer::~ModelServer() = default;

simulation::SimDisk& ModelServer::disk() {
    if (disk_.use_count() > 1) disk_ = std::make_shared<simulation::SimDisk>(*disk_);
    return *disk_;
}

void ModelServer::start() {
    host_->now = this;
    disk().open();
    appends_.clear();
    reported_ = 0;
    jobs_.clear();
    project_ = newProject(*readState(store(), options()));
}

Project::Options ModelServer::options() const {
    Project::Options options;
    options.name = "model";
    if (scenario_.readsBack) options.recentCommitBytes = 0;
    if (scenario_.forgetful) options.namespaceLogRevisions = 1;
    return options;
}

std::unique_ptr<Project::Impl> ModelServer::newProject(StoreState state) const {
    return std::make_unique<Project::Impl>(options(), host_->ports(), std::move(state),
                                           std::vector{LayerFile{kLayer}});
}

std::vector<Output> ModelServer::apply(Input input) {
    host_->now = this;
    switch (input.kind) {
        case Input::Connect:
            project_->connected(input.session, std::nullopt, "");
            break;
        case Input::Disconnect:
            project_->disconnected(input.session);
            break;
        case Input::Receive:
            project_->received(input.session, *messages_[input.argument]);
            break;
        case Input::Flush:
            flush(input.argument);
            break;
        case Input::Answer:
            answer(input.argument);
            break;
        case Input::Die:
            write(input.argument);
            start();
            break;
        case Input::DiskFull:
            diskFull();
            break;
        case Input::DiskFails:
            diskFails(input.argument);
            break;
        case Input::RollBack:
            disk().rollBack(store().head().revision - 1, input.argument != 0);
            start();
            break;
        default:
            throw std::logic_error("a server does not take this input");
    }
    return std::exchange(outputs_, {});
}

void ModelServer::digest(Digest& out) const {
    const CommitStore::Head head = store().head();
    out(head.revision, head.hash, head.epoch, appends_.size(), reported_, jobs_, *project_);
}

ModelServer::Summary ModelServer::summary() const {
    const History& history = archive_.of(store());
    const LayerDoc* loaded = project_->line_.doc(kLayer);
    return {&history, appends_.size() - reported_, jobs_.size(),
            !loaded || sha256(asBytes(loaded->dump())) == history.contents.back()};
}

// ---- the store

void ModelServer::flush(std::size_t commits) {
    const bool early = scenario_.flaw == Flaw::AcksEarly && store().head().revision > 0;
    if (early) {
        write(reported_);
        reported_ = commits;
        return project_->line_.appended(appends_[reported_ - 1].revision);
    }
    write(commits);
    project_->line_.appended(store().head().revision);
    if (scenario_.flaw != Flaw::Forgets) return;
    for (auto& [client, author] : project_->authors_.authors_)
        author.committed.emplace(ClientRecord{});
}

void ModelServer::write(std::size_t commits) {
    if (commits == 0) return;
    const auto end = appends_.begin() + std::ptrdiff_t(commits);
    const std::vector<CommitRecord> group(appends_.begin(), end);
    require(disk().append(group).has_value(), "the store does not take a commit");
    appends_.erase(appends_.begin(), end);
}

void ModelServer::diskFull() {
    disk().full = true;
    const auto done = disk().append({{appends_.front()}});
    disk().full = false;
    appends_.clear();
    project_->appendFailed(done.error(), store().head());
}

// When the store is open again, the project learns how many of the commits are durable all the
// same.
void ModelServer::diskFails(std::size_t written) {
    write(written);
    appends_.clear();
    disk().failed = true;
    project_->store_.closed = true;
    jobs_.push_back(OpenStoreAnew{});
}

// ---- the host's jobs

void ModelServer::answer(std::size_t index) {
    const Job job = std::move(jobs_[index]);
    jobs_.erase(jobs_.begin() + std::ptrdiff_t(index));
    std::visit([this](const auto& one) { done(one); }, job);
}

void ModelServer::done(const LoadLayer&) {
    if (disk_->failed) return project_->layers_.layerLoaded(kLayer, kClosed);
    const auto stored = disk_->store().loadLayer(kLayer);
    project_->layers_.layerLoaded(
        kLayer, *stored ? LoadedLayer{**stored}
                        : LoadedLayer{startingLayer(), *makeImport(kLayer, startingLayer())});
}

void ModelServer::done(const ReadClient& job) {
    if (disk_->failed) return project_->clientRead(job.client, kClosed);
    project_->clientRead(job.client, disk_->store().clientRecord(job.client));
}

void ModelServer::done(const ReadCommits& job) {
    if (disk_->failed) return project_->commitsRead(job.session, kClosed);
    std::vector<StoredCommit> commits;
    (void)store().read(job.from, job.to, [&](const StoredCommit& commit) {
        commits.push_back(commit);
        return true;
    });
    project_->commitsRead(job.session, std::move(commits));
}

void ModelServer::done(const SendSnapshot& job) {
    SnapshotEncoder encoder(job.doc, job.request);
    while (const auto frame = encoder.next())
        host_->send(job.session, std::make_shared<const Bytes>(encodeFrame(*frame)));
}

void ModelServer::done(const OpenStoreAnew&) {
    disk().open();
    project_->appendFailed({ErrorCode::StorageFailed, "the disk had failed"}, store().head());
}

}  // namespace usdlive::model
