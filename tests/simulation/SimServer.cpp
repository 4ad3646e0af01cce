// The real Project with a simulated process around it.
#include "SimServer.h"

#include <algorithm>
#include <iterator>

#include "project/CommitContent.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/CommitBlobs.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::simulation {

using namespace server;

namespace {

const tl::unexpected<Error> kClosed = fail(ErrorCode::StorageFailed, "the store is closed");

}  // namespace

SimServer::SimServer(SimClock& clock, SimRandom& random, SimNetwork& network,
                     std::map<LayerId, LayerDoc> files, Project::Options options)
    : clock_(clock),
      random_(random),
      network_(network),
      files_(std::move(files)),
      options_(std::move(options)) {
    network_.server = {[this](SessionId session, SharedBytes message) {
                           if (project_) project_->received(session, *message);
                       },
                       [this](SessionId session) {
                           if (project_) project_->disconnected(session);
                       },
                       [this](SessionId session) {
                           if (project_) project_->drained(session);
                       }};
}

void SimServer::start() {
    disk.open();
    ++process_;
    named_ = {};
    const std::vector<LayerId> stored = *store().layers();
    std::set<LayerId> layers(stored.begin(), stored.end());
    for (const auto& [layer, doc] : files_) layers.insert(layer);
    layers.insert({"broken.usda"});
    std::vector<LayerFile> served;
    for (const LayerId& layer : layers) served.push_back({layer});
    StoreState state = *readState(store(), options_);
    state.hasSpace = disk.reportsSpace;
    project_ = std::make_unique<Project>(options_, ports(), std::move(state), served);
    project_->setRules(rules_);
}

void SimServer::kill() {
    if (appending_ > 0 && !disk.full && !disk.failed && random_.chance(50)) {
        const std::vector<CommitRecord> group(appends_.begin(),
                                              appends_.begin() + std::ptrdiff_t(appending_));
        (void)disk.append(group);
    }
    project_.reset();
    ++process_;
    closed_ = false;
    appends_.clear();
    appending_ = 0;
    network_.cutAll();
}

void SimServer::connected(SessionId session, const UserName& user) {
    if (!project_) return;
    if (signsIn_)
        project_->connected(session, SignedIn{user, roleOf(user), user.value});
    else
        project_->connected(session);
}

// ---- what users may do

Role SimServer::roleOf(const UserName& user) const {
    const auto found = roles_.find(user);
    return found == roles_.end() ? Role::Editor : found->second;
}

void SimServer::setRole(const UserName& user, Role role) {
    roles_[user] = role;
    if (project_) project_->rolesChanged([this](const SignedIn& one) { return roleOf(one.user); });
}

void SimServer::setRules(AccessRules rules) {
    rules_ = std::make_shared<const AccessRules>(std::move(rules));
    if (project_) project_->setRules(rules_);
}

bool SimServer::allows(const UserName& user, const Edit& edit) const {
    const Role role = roleOf(user);
    const auto& path = edit.address.path;
    if (const auto action = projectActionOf(path, edit.action))
        return rules_->decide(AccessRules::ActionQuestion{user, role, *action, edit.layer})
            .isAllowed;
    const auto mayWrite = [&](OpinionKind kind) {
        return rules_->decide({user, role, edit.layer, path, kind}).isAllowed;
    };
    // The commit does not tell whether the spec was there before.
    for (const bool exists : {true, false}) {
        const auto kind = opinionKindOf(path, edit.action, exists);
        for (std::size_t other = 0; other < kOpinionKindNames.size(); ++other)
            if ((!kind || *kind == OpinionKind(other)) && mayWrite(OpinionKind(other))) return true;
    }
    return false;
}

void SimServer::checkAllowed(const CommitRecord& record) const {
    if (!signsIn_) return;
    const auto commit = decodeCommit({record.revision, record.frame, record.hash});
    require(commit.has_value(), "an ordered commit does not decode");
    if (commit->imported) return;
    for (const Edit& edit : commit->edits)
        require(allows(commit->user, edit),
                commit->user.value + ", who is " + std::string(nameOf(roleOf(commit->user))) +
                    ", may not edit " + edit.address.path + " of " + edit.layer.value +
                    ", but did in revision " + std::to_string(record.revision));
}

void SimServer::later(std::int64_t delayUs, std::function<void()> what) {
    clock_.in(delayUs, [this, process = process_, what = std::move(what)] {
        if (process == process_) what();
    });
}

std::int64_t SimServer::diskUs() { return random_.between(50, 8'000) * slowness; }

void SimServer::send(SessionId session, SharedBytes frames) {
    network_.sendToClient(session, std::move(frames));
}
void SimServer::sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                           Revision revision) {
    network_.sendCommit(sessions, frame, revision);
}
bool SimServer::isMulticast(SessionId session) const { return network_.isDds(session); }
bool SimServer::holdCommits(SessionId session) { return network_.holdCommits(session); }
void SimServer::releaseCommits(SessionId session, Revision next) {
    network_.releaseCommits(session, next);
}
bool SimServer::congested(SessionId session) { return network_.congested(session); }
bool SimServer::lags(SessionId session) {
    return !network_.isDds(session) && network_.congested(session);
}
void SimServer::close(SessionId session) { network_.closeByServer(session); }

// ---- commits

// Uses no random numbers, for the reason given at keepSnapshot().
void SimServer::readClient(const ClientId& client) {
    later(std::int64_t(++questions_ * 3'571 % 4'000) * slowness, [this, client] {
        if (closed_) return project_->clientRead(client, kClosed);
        project_->clientRead(client, store().clientRecord(client));
    });
}

void SimServer::sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) {
    for (const SessionId session : sessions) sendInitialState(session, update);
}
void SimServer::sendInitialState(SessionId session, const StateUpdate& all) {
    if (SharedBytes frame = encodeStateUpdate(all)) send(session, std::move(frame));
}
void SimServer::sendBeside(SessionId session, std::vector<SharedBytes> frames) {
    for (SharedBytes& frame : frames) send(session, std::move(frame));
}

void SimServer::setSpace(bool full, bool reportsSpace) {
    disk.full = full;
    disk.reportsSpace = reportsSpace;
    if (project_) project_->setSpace(reportsSpace);
}

void SimServer::append(CommitRecord commit) {
    require(!closed_, "the project writes to a closed store");
    checkAllowed(commit);
    appends_.push_back(std::move(commit));
    if (appending_ == 0) appendNext();
}

void SimServer::appendNext() {
    if (appends_.empty()) return;
    appending_ = 1 + random_.below(appends_.size());
    later(diskUs(), [this] { appendDone(); });
}

void SimServer::appendDone() {
    const std::vector<CommitRecord> group(appends_.begin(),
                                          appends_.begin() + std::ptrdiff_t(appending_));
    const auto done = disk.append(group);
    if (!done) {
        appends_.clear();
        appending_ = 0;
        if (!disk.failed) return project_->appendFailed(done.error(), store().head());
        closed_ = true;
        project_->storeClosed();
        return later(random_.between(1, 3'000) * 1'000, [this, group, error = done.error()] {
            disk.open();
            closed_ = false;
            // Some of the commits may be on the disk although append() failed.
            (void)disk.append({group.data(), random_.below(group.size() + 1)});
            project_->appendFailed(error, store().head());
        });
    }
    appends_.erase(appends_.begin(), appends_.begin() + std::ptrdiff_t(appending_));
    appending_ = 0;
    appendNext();
    project_->appended(store().head().revision);
}

// ---- layers and history

void SimServer::keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                             const Hash& hash) {
    // Uses no random numbers, so that the seeds that failed once still produce the same run.
    const auto delay = std::int64_t(revision * 7'919 % 30'000);
    later(delay, [this, layer, doc = std::move(doc), revision, hash] {
        // Sometimes this fails; another snapshot is due later.
        if (closed_ || revision % 7 == 0) return project_->snapshotKept(layer, kClosed);
        require(revision <= store().head().revision,
                "a snapshot is newer than the durable revision");
        require(doc.dump() == replay(layer, revision).dump(),
                "a snapshot differs from the committed layer");
        ++snapshots;
        const auto kept = store().keepSnapshot(layer, doc, revision, hash);
        // A base has meanwhile replaced commits beyond this revision.
        const bool isReplaced = !kept && kept.error().code == ErrorCode::HistoryReplaced;
        require(kept || isReplaced,
                "a snapshot was not stored: " + (kept ? "" : kept.error().message));
        project_->snapshotKept(layer, kept);
    });
}

void SimServer::loadLayer(const LayerId& layer) {
    const std::int64_t delay = random_.chance(20) ? random_.between(10'000, 500'000) : diskUs();
    later(delay, [this, layer] {
        if (closed_) return project_->layerLoaded(layer, kClosed);
        Replayed replayed;
        const auto stored = store().loadLayer(layer, &replayed);
        if (!stored) return project_->layerLoaded(layer, tl::unexpected(stored.error()));
        if (*stored) return project_->layerLoaded(layer, LoadedLayer{**stored, {}, {}, replayed});
        project_->layerNotStored(layer);
    });
}

void SimServer::importLayer(const LayerId& layer) {
    later(diskUs(), [this, layer] {
        const auto file = files_.find(layer);
        if (file == files_.end())
            return project_->layerLoaded(
                layer, fail(ErrorCode::LayerUnreadable, layer.value + " does not parse"));
        project_->layerLoaded(layer, LoadedLayer{file->second, *makeImport(layer, file->second)});
    });
}

void SimServer::readLayer(SessionId, std::uint64_t, const LayerId&) {
    throw SimFailure("readHistory() had an answer");
}

void SimServer::readCommits(SessionId session, Revision from, Revision to) {
    later(diskUs(), [this, session, from, to] {
        if (closed_) return project_->commitsRead(session, kClosed);
        std::vector<StoredCommit> commits;
        const auto read = store().read(from, to, [&](const StoredCommit& commit) {
            commits.push_back(commit);
            return true;
        });
        // A client that resumes at a commit which has just become the base is compared with that.
        require(read || read.error().code != ErrorCode::HistoryReplaced ||
                    from == store().base().revision,
                "the project needs a commit that a base replaced");
        if (!read) return project_->commitsRead(session, tl::unexpected(read.error()));
        project_->commitsRead(session, std::move(commits));
    });
}

bool SimServer::serves(const Welcome& welcome, Revision revision, const LayerDocs& layers) const {
    const auto& commits = disk.commits();
    const bool isPresent = welcome.store == store().identity() && welcome.revision > 0 &&
                           welcome.revision <= commits.size() &&
                           commits[welcome.revision - 1].hash == welcome.hash;
    if (!isPresent || revision < welcome.base.value_or(0)) return true;
    return revision <= commits.size() && std::ranges::all_of(layers, [&](const auto& one) {
               return replay(one.first, revision).dump() == one.second.dump();
           });
}

LayerDoc SimServer::replay(const LayerId& layer, Revision revision) const {
    LayerDocs docs;
    NamespaceLog log;
    docs[layer];
    for (const CommitRecord& stored : disk.commits()) {
        if (stored.revision > revision) break;
        const auto commit = decodeCommit({stored.revision, stored.frame, stored.hash});
        require(commit.has_value(), "a stored commit does not decode: " +
                                        (commit ? std::string() : commit.error().message));
        const auto applied = applyCommit(docs, log, *commit);
        require(applied.has_value(), "a stored commit does not apply");
    }
    return docs.at(layer);
}

void SimServer::readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                            Revision revision) {
    later(diskUs(), [this, session, request, layer, revision] {
        if (closed_) return project_->historyRead(session, request, kClosed);
        auto doc = replay(layer, revision);
        const auto stored = store().layerAt(layer, revision);
        require(stored.has_value(), "a layer of the history cannot be read");
        require(doc == LayerDoc() || (*stored && (*stored)->dump() == doc.dump()),
                "a layer of the history differs from the committed layer");
        project_->historyRead(session, request, std::move(doc));
    });
}

// Uses no random numbers, for the reason given at keepSnapshot().
void SimServer::findBase(std::int64_t beforeMs, Revision upTo) {
    later(std::int64_t(upTo * 4'111 % 20'000), [this, beforeMs, upTo] {
        if (closed_) return project_->baseFound(kClosed);
        project_->baseFound(server::findBase(store(), beforeMs, upTo));
    });
}

void SimServer::compact(Revision revision) {
    later(std::int64_t(revision * 6'151 % 200'000), [this, revision] {
        if (closed_ || revision % 5 == 0) return project_->compacted(kClosed);
        const auto done = store().compact(revision, [] { return true; });
        require(done.has_value(), "the history cannot be compacted");
        require(store().base().revision == revision, "the history has another base");
        ++compactions;
        project_->baseChanged(store().base());
        project_->compacted(CompactOutcome{});
    });
}

void SimServer::sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) {
    auto encoder = std::make_shared<SnapshotEncoder>(std::move(doc), request);
    std::int64_t delay = 0;
    while (auto frame = encoder->next()) {
        delay += random_.between(0, 3'000);
        later(delay, [this, session, frame = std::make_shared<SnapshotFrame>(std::move(*frame))] {
            send(session, std::make_shared<const Bytes>(encodeFrame(*frame)));
        });
    }
}

void SimServer::saveLayers(SessionId session, std::uint64_t request, std::vector<SaveJob> jobs) {
    later(diskUs() * 4, [this, session, request, jobs = std::move(jobs)] {
        SaveOutcome outcome;
        for (const SaveJob& job : jobs) {
            require(job.doc.dump() == replay(job.layer, job.revision).dump(),
                    "a saved file differs from the committed layer");
            (void)store().setSaved(job.layer, {job.revision, {}});
            outcome.saved.emplace_back(job.layer, FileStamp());
            outcome.revision = job.revision;
        }
        project_->layersSaved(session, request, outcome);
    });
}

void SimServer::addCheckpoint(SessionId session, std::uint64_t request,
                              const Checkpoint& checkpoint) {
    later(diskUs(), [this, session, request, checkpoint] {
        const auto added = store().addCheckpoint(checkpoint);
        if (!added)
            require(added.error().code == ErrorCode::CheckpointExists,
                    "a checkpoint was not stored: " + added.error().message);
        project_->checkpointAdded(session, request, added.map([&] { return checkpoint; }));
    });
}

void SimServer::readCheckpoints(SessionId session, std::uint64_t request) {
    later(diskUs(), [this, session, request] {
        project_->checkpointsRead(session, request, store().checkpoints());
    });
}

/// Simulates that somebody restored the layer's file to an earlier content.
void SimServer::reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                            LayerDoc present) {
    later(diskUs() * 4, [this, session, request, layer, present = std::move(present)] {
        if (random_.chance(10))
            return project_->layerReloaded(session, request, layer,
                                           fail(ErrorCode::LayerUnreadable, "it does not parse"));
        LayerDoc content = replay(layer, random_.below(store().head().revision + 1));
        // A real file would contain its big values; here, removed values cannot be read.
        bool isWhole = true;
        forEachBlob(content,
                    [&](const Value& blob) { isWhole = isWhole && disk.blobs->has(blob.hash()); });
        if (!isWhole) content = present;
        project_->layerReloaded(session, request, layer,
                                makeReload(layer, present, content, FileStamp()));
    });
}

void SimServer::createLayerFile(SessionId session, std::uint64_t request, const LayerId& layer) {
    later(diskUs(), [this, session, request, layer] {
        Result<void> created;
        if (files_.contains(layer))
            created = fail(ErrorCode::LayerExists, "there is such a file");
        else if (random_.chance(20))
            created = fail(ErrorCode::SaveFailed, "the folder cannot be written");
        else
            files_.emplace(layer, LayerDoc());
        project_->layerCreated(session, request, layer, created);
    });
}

void SimServer::storeFile(SessionId session, std::uint64_t request, UploadJob job) {
    later(diskUs(), [this, session, request, job = std::move(job)] {
        project_->fileStored(session, request, job.path, disk.blobs->has(job.hash));
    });
}

void SimServer::listSkipped(SessionId session, std::uint64_t request) {
    later(diskUs(), [this, session, request] {
        project_->skippedListed(session, request, std::vector<SkippedFile>());
    });
}

// ---- big values

void SimServer::sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) {
    const std::uint64_t size = *disk.blobs->size(hash);
    std::int64_t delay = 0;
    while (offset < size) {
        const Bytes part = *disk.blobs->read(hash, offset, kChunkBytes);
        auto frame = std::make_shared<const Bytes>(
            encodeFrame(BlobFrame{hash, size, offset, std::uint32_t(part.size()), deflate(part)}));
        offset += part.size();
        delay += random_.between(0, 5'000);
        later(delay, [this, session, frame] { send(session, frame); });
    }
}

void SimServer::findBlobs(std::vector<Hash> hashes) {
    later(std::int64_t(++questions_ * 3'571 % 4'000) * slowness,
          [this, hashes = std::move(hashes)] {
              std::vector<Hash> stored;
              std::ranges::copy_if(hashes, std::back_inserter(stored),
                                   [this](const Hash& hash) { return disk.blobs->has(hash); });
              project_->blobsFound(hashes, stored);
          });
}

void SimServer::writeBlob(SessionId session, const std::string& /*share*/, BlobFrame part) {
    blobUs_ = std::max(blobUs_, clock_.nowUs() + diskUs());
    later(blobUs_ - clock_.nowUs(), [this, session, part = std::move(part)] {
        if (disk.blobs->has(part.hash))
            return project_->blobWritten(
                session, part.hash, part.offset == 0 || part.offset + part.rawBytes == part.size);
        if (disk.full)
            return project_->blobWritten(session, part.hash,
                                         fail(ErrorCode::StorageFull, "no room for it"));
        const auto raw = inflate(part.data, part.rawBytes, kChunkBytes);
        require(raw.has_value(), "a chunk of a big value cannot be decompressed");
        const auto whole = disk.blobs->write(part.hash, part.size, part.offset, *raw, session);
        project_->blobWritten(session, part.hash, whole);
    });
}

void SimServer::removeUnfinished(SessionId session) {
    blobUs_ = std::max(blobUs_, clock_.nowUs() + diskUs());
    later(blobUs_ - clock_.nowUs(), [this, session] { disk.blobs->forget(session); });
}

void SimServer::forgetClients() {
    if (closed_ || !project_) return;
    const auto some = store().forgetClients(2, project_->activeClients());
    require(some.has_value(), "clients cannot be forgotten");
    forgotten += *some;
    project_->clientsForgotten(store().forgottenUpTo());
}

// Uses no random numbers either.
void SimServer::collect() {
    if (!project_) return;
    const auto delay = [this] { return std::int64_t(++rounds_ * 7'919 % 30'000) * slowness; };
    later(delay(), [this, delay, stored = *disk.blobs->list()] {
        if (closed_) return;
        while (!*named_.read(store(), 2'000)) {
        }
        std::vector<Hash> unnamed;
        for (const Hash& hash : stored)
            if (!named_.contains(hash)) unnamed.push_back(hash);
        later(delay(), [this, delay, unnamed, upTo = named_.upTo()] {
            drop(project_->unusedBlobs(unnamed, upTo, clock_.nowMs()));
            later(delay(), [this] {
                const auto purged = disk.blobs->purge(1 + rounds_ % 3);
                require(purged.has_value(), "a dropped value cannot be removed");
            });
        });
    });
}

void SimServer::drop(const std::vector<Hash>& unused) {
    const std::set<Hash> named = namedByCommits();
    for (const Hash& hash : unused)
        require(!named.contains(hash), "a value was removed that a commit names");
    disk.drop(unused);
    collected += unused.size();
}

std::set<Hash> SimServer::namedByCommits() const {
    std::set<Hash> named;
    const auto look = [&](const Bytes& message) {
        const auto frames = splitMessage(message);
        for (const ByteView frame : *frames) {
            const auto looked = forEachBlob(frame, [&](const Hash& hash) { named.insert(hash); });
            require(looked.has_value(), "a commit does not decode");
        }
    };
    const Revision base = store().base().revision;
    const auto layers = store().layers();
    for (const LayerId& layer : *layers)
        if (const auto doc = store().layerAt(layer, base); base > 0 && *doc)
            forEachBlob(**doc, [&](const Value& blob) { named.insert(blob.hash()); });
    const auto read = store().read(base + 1, ~Revision(0), [&](const StoredCommit& stored) {
        look(*stored.frame);
        return true;
    });
    require(read.has_value(), "the commits cannot be read");
    for (const CommitRecord& commit : appends_) look(*commit.frame);
    return named;
}

void SimServer::checkBlobs() {
    const std::set<Hash> named = namedByCommits();
    for (const Hash& hash : named)
        require(disk.blobs->has(hash), "a commit names a value that was removed");
    while (!*named_.read(store(), ~std::size_t(0))) {
    }
    std::vector<Hash> unnamed;
    const auto stored = disk.blobs->list();
    for (const Hash& hash : *stored)
        if (!named_.contains(hash)) unnamed.push_back(hash);
    // Runs two rounds, and waits between them as long as values are kept.
    for (const std::int64_t afterMs : {0, 3'600'000, 7'200'000})
        drop(project_->unusedBlobs(unnamed, named_.upTo(), clock_.nowMs() + afterMs));
    require(disk.blobs->list()->size() == named.size(), "unused values are never removed");
}

}  // namespace usdlive::simulation
