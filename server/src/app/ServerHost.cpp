#include "usdlive/server/app/ServerHost.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <nlohmann/json.hpp>
#include <utility>

#include "usdlive/common/protocol/Snapshot.h"
#include "usdlive/server/app/Faults.h"
#include "usdlive/server/app/StorageUse.h"

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kGoodbyeTime{2'000};
constexpr milliseconds kRetryPause{1'000};
// Looking for files that are new or changed: so often, and never more than this part of the time.
constexpr milliseconds kScanPause{1'000};
constexpr int kScanPart = 20;
// Of so many clients the store knows what they have committed (M14); every so often the others are
// forgotten.
constexpr std::size_t kKnownClients = 20'000;
constexpr milliseconds kForgetPause{10 * 60'000};
// From one look at the free space to the next.
constexpr milliseconds kSpacePause{500};
// From one look at commits that are too old to the next.
constexpr milliseconds kHistoryPause{60 * 60 * 1'000};
constexpr int kKeeperNice = 10;
// A save tells how far it is so often, from then on when it takes so long (PG1).
constexpr milliseconds kProgressPause{500};
// Commits of the past are read for a session until they have so many bytes; the rest is asked for
// later.
constexpr std::size_t kReadBytes = 16 * 1024 * 1024;

SharedBytes encoded(const Frame& frame) {
    return std::make_shared<const Bytes>(encodeFrame(frame));
}

SharedBytes blobError(const Hash& hash, const Error& error) {
    return encoded(ControlFrame{encodeControl(
        ErrorMessage{std::string(errorName(error.code)), error.message, false, {}, hash})});
}

/// The parts of a big value, one at each call.
class BlobSource {
public:
    BlobSource(const BlobStore& blobs, const Hash& hash, std::uint64_t offset)
        : blobs_(blobs), hash_(hash), offset_(offset) {}

    SharedBytes operator()() {
        if (done_) return nullptr;
        const auto size = blobs_.size(hash_);
        if (!size) return failed(size.error());
        const auto part = blobs_.read(hash_, offset_, kChunkBytes);
        if (!part) return failed(part.error());
        done_ = part->empty() || offset_ + part->size() >= *size;
        if (part->empty()) return nullptr;
        return encoded(BlobFrame{hash_, *size, std::exchange(offset_, offset_ + part->size()),
                                 std::uint32_t(part->size()), deflate(*part)});
    }

private:
    SharedBytes failed(const Error& error) {
        done_ = true;
        return blobError(hash_, error);
    }

    const BlobStore& blobs_;
    Hash hash_;
    std::uint64_t offset_;
    bool done_ = false;
};

/// What `work` returns, or what it threw as an error.
template <class Work>
auto resultOf(Work& work) -> decltype(work()) {
    try {
        return work();
    } catch (const std::exception& fault) {
        return fail(ErrorCode::Internal, fault.what());
    }
}

}  // namespace

ServerHost::ServerHost(asio::io_context& network, WorkerLanes& workers, SharedStore& store,
                       StorageThread& storage, BlobStore& blobs, ProjectFiles files,
                       milliseconds keepUnusedBlobs, Metrics& metrics, WallClock clock, Log& log)
    : network_(network),
      workers_(workers),
      blobWriter_(asio::make_strand(workers.joins.get_executor())),
      saver_(asio::make_strand(workers.files.get_executor())),
      checkpoints_(asio::make_strand(workers.history.get_executor())),
      snapshotWriter_(asio::make_strand(workers.history.get_executor())),
      store_(store),
      storage_(storage),
      blobs_(blobs),
      files_(std::move(files)),
      metrics_(metrics),
      clock_(std::move(clock)),
      log_(log),
      retryTimer_(network),
      scanTimer_(network),
      sweepTimer_(network),
      clientsTimer_(network),
      historyTimer_(network),
      spaceTimer_(network),
      collector_(network, workers.history, store, blobs, keepUnusedBlobs, log),
      intake_([this](SessionId session, bool reading) {
          transportOf(session).setReading(session, reading);
      }) {
    // Others come first.
    asio::post(keeper_, [] { ::setpriority(PRIO_PROCESS, id_t(::gettid()), kKeeperNice); });
}

ServerHost::~ServerHost() {
    stopping_ = true;
    keeper_.join();
}

Result<void> ServerHost::start(ProjectSetup setup) {
    setup_ = std::move(setup);
    auto beginning = setup_.read();
    if (!beginning) return tl::unexpected(beginning.error());
    hasSpace_ = beginning->store.hasSpace;
    makeProject(std::move(*beginning));
    storage_.start({
        .appended =
            [this](Revision upTo) {
                onProject([this, upTo](Project& project) {
                    while (!appending_.empty() && appending_.begin()->first <= upTo)
                        intake_.endStore(appending_.extract(appending_.begin()).mapped());
                    project.appended(upTo);
                });
            },
        .failed =
            [this](Error error, CommitStore::Head head) {
                onProject([this, error = std::move(error), head](Project& project) {
                    if (!storage_.goOn()) return;  // the project was made anew meanwhile
                    for (const auto& [revision, bytes] : std::exchange(appending_, {}))
                        intake_.endStore(bytes);
                    project.appendFailed(error, head);
                });
            },
        .closed = [this] { onProject([](Project& project) { project.storeClosed(); }); },
        .measured = [this](std::size_t commits,
                           std::chrono::nanoseconds time) { metrics_.appended(commits, time); },
    });
    return {};
}

void ServerHost::serve(std::vector<Transport*> transports) {
    transports_ = std::move(transports);
    scanFilesIn(kScanPause);
    forgetClientsIn(kForgetPause);
    collector_.start([this](const std::vector<Hash>& unnamed, Revision upTo, std::int64_t nowMs) {
        std::vector<Hash> unused;
        guarded([&] {
            if (project_) unused = project_->unusedBlobs(unnamed, upTo, nowMs);
        });
        return unused;
    });
    boundHistoryIn(milliseconds(0));
    lookForSpaceIn(milliseconds(0));
}

void ServerHost::stop(std::function<void()> done) {
    stopping_ = true;
    // First what is on its way to the store, so that its authors hear of it before the goodbye.
    storage_.flush([this, done = std::move(done)]() mutable {
        asio::post(network_, [this, done = std::move(done)]() mutable {
            const Error why{ErrorCode::ShuttingDown,
                            std::string(errorText(ErrorCode::ShuttingDown))};
            const auto left = std::make_shared<std::size_t>(transports_.size());
            for (Transport* transport : transports_)
                transport->stop(why, kGoodbyeTime, [left, done] {
                    if (--*left == 0) done();
                });
        });
    });
}

HttpReply ServerHost::health() {
    nlohmann::json answer{{"status", hasSpace_ ? "ok" : "storageFull"},
                          {"project", files_.folder.filename().string()},
                          {"revision", project_ ? project_->durableRevision() : 0}};
    if (!project_) answer["status"] = "starting";
    return {"application/json",
            answer.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n"};
}

HttpReply ServerHost::metricsPage() {
    Figures figures;
    for (const Transport* transport : transports_)
        figures.transports.emplace_back(transport->name(), transport->counters());
    figures.appendQueueBytes = intake_.storeBytes();
    figures.storageHasSpace = hasSpace_;
    figures.removedBlobs = collector_.removed();
    std::error_code ignored;
    figures.storageFreeBytes = std::filesystem::space(files_.folder, ignored).available;
    if (project_) {
        figures.project = project_->counters();
        figures.sessions = project_->sessionCount();
        figures.durableRevision = project_->durableRevision();
    }
    return {"text/plain; version=0.0.4", metrics_.page(figures)};
}

// --- Sessions

void ServerHost::opened(SessionId session) {
    if (!project_)
        return transportOf(session).close(session, Error{ErrorCode::Internal, "starting again"});
    project_->connected(session);
}

void ServerHost::received(SessionId session, ByteView message) {
    if (!project_) return;
    project_->received(session, message);
    intake_.received(session);
    sweepSoon();
}

void ServerHost::closed(SessionId session) {
    intake_.closed(session);
    asio::post(blobWriter_, [this, session] { blobs_.forget(session); });
    guarded([&] {
        if (project_) project_->disconnected(session);
    });
}

void ServerHost::drained(SessionId session) {
    guarded([&] {
        if (project_) project_->drained(session);
    });
}

Transport& ServerHost::transportOf(SessionId session) {
    return *transports_.at(session / Transport::kSessions);
}

void ServerHost::send(SessionId session, SharedBytes frames) {
    transportOf(session).send(session, std::move(frames));
}

/// Calls `each(Transport&, its sessions)`. They stand together, the ids being sorted; one without
/// any is called, too.
template <class Each>
void ServerHost::forTransports(std::span<const SessionId> sessions, Each each) {
    for (Transport* transport : transports_) {
        std::size_t count = 0;
        while (count < sessions.size() && &transportOf(sessions[count]) == transport) ++count;
        each(*transport, sessions.first(count));
        sessions = sessions.subspan(count);
    }
}

void ServerHost::sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                            Revision revision) {
    forTransports(sessions, [&](Transport& transport, std::span<const SessionId> its) {
        transport.sendCommit(its, frame, revision);
    });
}

void ServerHost::tell(std::span<const SessionId> sessions, const News& news) {
    forTransports(sessions, [&](Transport& transport, std::span<const SessionId> its) {
        transport.tell(its, news);
    });
}

void ServerHost::tellFirst(SessionId session, const News& all) {
    transportOf(session).tellFirst(session, all);
}

bool ServerHost::holdCommits(SessionId session) {
    return transportOf(session).holdCommits(session);
}

void ServerHost::releaseCommits(SessionId session, Revision next) {
    transportOf(session).releaseCommits(session, next);
}

bool ServerHost::congested(SessionId session) { return transportOf(session).congested(session); }

bool ServerHost::lags(SessionId session) { return transportOf(session).lags(session); }

void ServerHost::close(SessionId session) { transportOf(session).close(session); }

void ServerHost::closeAll(const Error& why) {
    for (Transport* transport : transports_) transport->closeAll(why);
}

void ServerHost::sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) {
    auto encoder = std::make_shared<SnapshotEncoder>(std::move(doc), request);
    transportOf(session).sendBeside(session, [encoder]() -> SharedBytes {
        const auto frame = encoder->next();
        return frame ? encoded(*frame) : nullptr;
    });
}

void ServerHost::sendBlob(SessionId session, const Hash& hash, std::uint64_t offset) {
    transportOf(session).sendBeside(session, BlobSource(blobs_, hash, offset));
}

// --- What blocks

/// Calls `tell(Project&)` on the network thread, unless the project is another one by then.
template <class Tell>
void ServerHost::onProject(Tell tell) {
    asio::post(network_, [this, tell = std::move(tell)]() mutable {
        guarded([&] {
            if (project_) tell(*project_);
        });
    });
}

/// A bug met while no session's message was at work: the project is made again from its store.
template <class Tell>
void ServerHost::guarded(Tell&& tell) {
    try {
        tell();
    } catch (const std::exception& fault) {
        log_.write(LogLevel::Error, "project met a fault", {{"error", fault.what()}});
        startAgain();
    }
}

/// Runs `work()`, which returns a Result, on `executor`, then `tell(Project&, result)` here. Counts
/// as `bytes` of the session's share until then.
template <class Executor, class Work, class Tell>
void ServerHost::inBackground(Executor& executor, SessionId session, std::size_t bytes, Work work,
                              Tell tell) {
    intake_.begin(session, bytes);
    asio::post(executor, [this, session, bytes, generation = generation_, work = std::move(work),
                          tell = std::move(tell)]() mutable {
        auto result = resultOf(work);
        asio::post(network_, [this, session, bytes, generation, tell = std::move(tell),
                              result = std::move(result)]() mutable {
            intake_.end(session, bytes);
            if (generation != generation_) return;
            guarded([&] {
                if (project_) tell(*project_, std::move(result));
            });
        });
    });
}

void ServerHost::append(CommitRecord commit) {
    std::size_t bytes = Intake::kJobBytes / 64;
    if (commit.frame) bytes += commit.frame->size();
    intake_.beginStore(bytes);
    appending_[commit.revision] = bytes;
    storage_.append(std::move(commit));
}

void ServerHost::keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                              const Hash& hash) {
    inBackground(
        snapshotWriter_, 0, 0,
        [this, layer, doc = std::move(doc), revision, hash] {
            faultPoint("snapshot");
            auto kept = store_.use(
                [&](CommitStore& store) { return store.keepSnapshot(layer, doc, revision, hash); });
            if (!kept)
                log_.write(LogLevel::Warning, "snapshot not kept",
                           {{"layer", layer.value}, {"error", kept.error().message}});
            return kept;
        },
        [layer](Project& project, const Result<std::size_t>& kept) {
            project.snapshotKept(layer, kept);
        });
}

void ServerHost::loadLayer(const LayerId& layer) {
    inBackground(
        workers_.joins, 0, 0, [this, layer] { return loadStored(layer); },
        [layer](Project& project, Result<std::optional<LoadedLayer>> stored) {
            if (!stored) return project.layerLoaded(layer, tl::unexpected(stored.error()));
            if (*stored) return project.layerLoaded(layer, std::move(**stored));
            project.layerNotStored(layer);
        });
}

void ServerHost::importLayer(const LayerId& layer) {
    inBackground(
        workers_.files, 0, 0, [this, layer] { return import(layer); },
        [layer](Project& project, Result<LoadedLayer> imported) {
            project.layerLoaded(layer, std::move(imported));
        });
}

Result<std::optional<LoadedLayer>> ServerHost::loadStored(const LayerId& layer) {
    Replayed replayed;
    auto stored = store_.use([&](CommitStore& store) { return store.loadLayer(layer, &replayed); });
    if (!stored) return tl::unexpected(stored.error());
    if (!*stored) return std::nullopt;
    auto saved = store_.use([&](CommitStore& store) { return store.saved(layer); });
    if (!saved) return tl::unexpected(saved.error());
    return LoadedLayer{std::move(**stored), {}, std::move(*saved), replayed};
}

Result<LoadedLayer> ServerHost::import(const LayerId& layer) {
    faultPoint("import");
    onProject([layer](Project& project) { project.layerBeingImported(layer); });
    const auto begin = steady_clock::now();
    auto imported = files_.layers.import(layer);
    if (!imported) {
        log_.write(LogLevel::Warning, "layer cannot be read",
                   {{"layer", layer.value}, {"error", imported.error().message}});
        return tl::unexpected(imported.error());
    }
    auto& [doc, file] = *imported;
    auto commit = makeImport(layer, doc);
    if (!commit) return tl::unexpected(commit.error());
    const auto time = std::chrono::duration_cast<milliseconds>(steady_clock::now() - begin);
    log_.write(LogLevel::Info, "file read",
               {{"layer", layer.value}, {"specs", doc.specCount()}, {"ms", time.count()}});
    return LoadedLayer{std::move(doc), std::move(*commit), {0, file}};
}

void ServerHost::readCommits(SessionId session, Revision from, Revision to) {
    inBackground(
        workers_.joins, session, Intake::kJobBytes,
        [this, from, to] {
            return store_.use([&](CommitStore& store) -> Result<std::vector<StoredCommit>> {
                std::vector<StoredCommit> commits;
                std::size_t bytes = 0;
                const auto read = store.read(from, to, [&](const StoredCommit& commit) {
                    bytes += commit.frame->size();
                    commits.push_back(commit);
                    return bytes < kReadBytes;
                });
                if (!read) return tl::unexpected(read.error());
                return commits;
            });
        },
        [session](Project& project, Result<std::vector<StoredCommit>> commits) {
            project.commitsRead(session, std::move(commits));
        });
}

void ServerHost::readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                             Revision revision) {
    inBackground(
        workers_.history, session, Intake::kJobBytes,
        [this, layer, revision] {
            return store_.use([&](CommitStore& store) { return store.layerAt(layer, revision); });
        },
        [session, request](Project& project, Result<std::optional<LayerDoc>> stored) {
            if (!stored)
                return project.historyRead(session, request, tl::unexpected(stored.error()));
            if (*stored) return project.historyRead(session, request, std::move(**stored));
            project.historyNotStored(session, request);
        });
}

void ServerHost::readLayer(SessionId session, std::uint64_t request, const LayerId& layer) {
    inBackground(
        workers_.history, session, Intake::kJobBytes,
        [this, layer] {
            return files_.layers.import(layer).map(
                [](ImportedLayer&& found) { return std::move(found.doc); });
        },
        [session, request](Project& project, Result<LayerDoc> doc) {
            project.historyRead(session, request, std::move(doc));
        });
}

void ServerHost::readClient(const ClientId& client) {
    inBackground(
        workers_.joins, 0, 0,
        [this, client] {
            return store_.use([&](CommitStore& store) { return store.clientRecord(client); });
        },
        [client](Project& project, const Result<ClientRecord>& record) {
            project.clientRead(client, record);
        });
}

void ServerHost::sendBeside(SessionId session, std::vector<SharedBytes> frames) {
    transportOf(session).sendBeside(
        session, [frames = std::move(frames), next = std::size_t(0)]() mutable -> SharedBytes {
            return next < frames.size() ? frames[next++] : nullptr;
        });
}

void ServerHost::writeBlob(SessionId session, BlobFrame part) {
    const Hash hash = part.hash;
    const std::size_t bytes = Intake::kJobBytes + part.data.size();
    inBackground(
        blobWriter_, session, bytes,
        [this, session, part = std::move(part)] { return write(session, part); },
        [session, hash](Project& project, Result<bool> whole) {
            project.blobWritten(session, hash, std::move(whole));
        });
}

Result<bool> ServerHost::write(SessionId session, const BlobFrame& part) {
    if (blobs_.has(part.hash)) return part.offset == 0 || part.offset + part.rawBytes == part.size;
    return inflate(part.data, part.rawBytes, kChunkBytes).and_then([&](const Bytes& raw) {
        return blobs_.write(part.hash, part.size, part.offset, raw, session);
    });
}

void ServerHost::findBlobs(std::vector<Hash> hashes) {
    auto asked = std::make_shared<const std::vector<Hash>>(std::move(hashes));
    inBackground(
        workers_.joins, 0, 0,
        [this, asked] {
            std::vector<Hash> stored;
            std::ranges::copy_if(*asked, std::back_inserter(stored),
                                 [this](const Hash& hash) { return blobs_.has(hash); });
            return Result<std::vector<Hash>>(std::move(stored));
        },
        [asked](Project& project, const Result<std::vector<Hash>>& stored) {
            project.blobsFound(*asked, stored.value_or(std::vector<Hash>()));
        });
}

// Asked for now and then, as others fill the disk and empty it, too.
void ServerHost::lookForSpaceIn(milliseconds pause) {
    spaceTimer_.expires_after(pause);
    spaceTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        asio::post(workers_.joins, [this] {
            const auto found =
                store_.use([](CommitStore& store) -> Result<bool> { return store.hasSpace(); });
            asio::post(network_, [this, found] {
                hasSpace_ = found.value_or(hasSpace_);
                guarded([&] {
                    if (project_) project_->setSpace(hasSpace_);
                });
                lookForSpaceIn(kSpacePause);
            });
        });
    });
}

void ServerHost::saveLayers(SessionId session, std::uint64_t request, std::vector<SaveJob> jobs) {
    inBackground(
        saver_, session, Intake::kJobBytes,
        [this, session, request, jobs = std::move(jobs)]() -> Result<SaveOutcome> {
            return save(session, request, jobs);
        },
        [session, request](Project& project, Result<SaveOutcome> saved) {
            project.layersSaved(session, request, std::move(*saved));
        });
}

void ServerHost::addCheckpoint(SessionId session, std::uint64_t request,
                               const Checkpoint& checkpoint) {
    inBackground(
        checkpoints_, session, Intake::kJobBytes,
        [this, checkpoint] {
            return store_.use([&](CommitStore& store) { return store.addCheckpoint(checkpoint); })
                .map([&] { return checkpoint; });
        },
        [session, request](Project& project, const Result<Checkpoint>& added) {
            project.checkpointAdded(session, request, added);
        });
}

void ServerHost::readCheckpoints(SessionId session, std::uint64_t request) {
    inBackground(
        checkpoints_, session, Intake::kJobBytes,
        [this] { return store_.use([](CommitStore& store) { return store.checkpoints(); }); },
        [session, request](Project& project, Result<std::vector<Checkpoint>> read) {
            project.checkpointsRead(session, request, std::move(read));
        });
}

void ServerHost::checkFile(const LayerId& layer) {
    inBackground(
        saver_, 0, 0, [this, layer] { return files_.layers.stamp(layer); },
        [layer](Project& project, Result<std::optional<FileStamp>> file) {
            project.fileChecked(layer, std::move(file));
        });
}

void ServerHost::reloadLayer(SessionId session, std::uint64_t request, const LayerId& layer,
                             LayerDoc present) {
    inBackground(
        saver_, session, Intake::kJobBytes,
        [this, layer, present = std::move(present)]() -> Result<ReloadedLayer> {
            auto imported = files_.layers.import(layer);
            if (!imported) return tl::unexpected(imported.error());
            return makeReload(layer, present, imported->doc, imported->file);
        },
        [session, request, layer](Project& project, Result<ReloadedLayer> reloaded) {
            project.layerReloaded(session, request, layer, std::move(reloaded));
        });
}

void ServerHost::setSaved(const LayerId& layer, const SavedState& saved) {
    asio::post(saver_, [this, layer, saved] {
        const auto set =
            store_.use([&](CommitStore& store) { return store.setSaved(layer, saved); });
        if (!set)
            log_.write(LogLevel::Warning, "the store does not know that a layer is saved",
                       {{"layer", layer.value}, {"error", set.error().message}});
    });
}

Result<FileStamp> ServerHost::save(const SaveJob& job) {
    faultPoint("save-before");
    std::vector<Hash> expected;
    if (job.minds && job.saved.file) expected.push_back(job.saved.file->hash);
    if (job.minds && job.saved.coming) expected.push_back(job.saved.coming->hash);
    auto saved = files_.layers.save(job.layer, job.doc, expected, [&](const Hash& hash) {
        SavedState state = job.saved;
        state.coming = SavedState::Coming{job.revision, hash};
        return store_.use([&](CommitStore& store) { return store.setSaved(job.layer, state); });
    });
    faultPoint("save-after");
    if (!saved) return saved;
    return store_
        .use([&](CommitStore& store) { return store.setSaved(job.layer, {job.revision, *saved}); })
        .map([&] { return *saved; });
}

SaveOutcome ServerHost::save(SessionId session, std::uint64_t request,
                             const std::vector<SaveJob>& jobs) {
    SaveOutcome outcome;
    auto told = steady_clock::now();
    for (std::size_t index = 0; index < jobs.size(); ++index) {
        const SaveJob& job = jobs[index];
        if (steady_clock::now() - told >= kProgressPause) {
            told = steady_clock::now();
            onProject([=, layer = job.layer, total = jobs.size()](Project& project) {
                project.layersBeingSaved(session, request, layer, index, total);
            });
        }
        outcome.revision = std::max(outcome.revision, job.revision);
        auto work = [&] { return save(job); };
        if (const auto saved = resultOf(work)) {
            outcome.saved.emplace_back(job.layer, *saved);
        } else {
            log_.write(LogLevel::Error, "layer not saved",
                       {{"layer", job.layer.value}, {"error", saved.error().message}});
            outcome.failed.push_back(
                {job.layer, std::string(errorName(saved.error().code)), saved.error().message});
        }
    }
    return outcome;
}

void ServerHost::createLayerFile(SessionId session, std::uint64_t request, const LayerId& layer) {
    inBackground(
        saver_, session, Intake::kJobBytes, [this, layer] { return files_.layers.create(layer); },
        [session, request, layer](Project& project, const Result<void>& created) {
            project.layerCreated(session, request, layer, created);
        });
}

void ServerHost::listSkipped(SessionId session, std::uint64_t request) {
    inBackground(
        workers_.files, session, Intake::kJobBytes, [this] { return files_.layers.skipped(); },
        [session, request](Project& project, Result<std::vector<SkippedFile>> skipped) {
            project.skippedListed(session, request, std::move(skipped));
        });
}

void ServerHost::happened(const Happening& happening) {
    const auto now =
        std::chrono::duration_cast<milliseconds>(steady_clock::now().time_since_epoch());
    std::string key(happening.what);
    key += '\n' + happening.user.value;
    const auto leftOut = logLimit_.take(key, now.count());
    if (!leftOut) return;
    const std::string_view user = happening.user.value, layer = happening.layer.value;
    if (*leftOut > 0)
        log_.write(LogLevel::Warning, "lines left out",
                   {{"of", happening.what}, {"user", user}, {"count", *leftOut}});
    if (layer.empty() && happening.detail.empty())
        log_.write(LogLevel::Info, happening.what, {{"user", user}});
    else if (layer.empty())
        log_.write(LogLevel::Info, happening.what, {{"user", user}, {"detail", happening.detail}});
    else if (happening.detail.empty())
        log_.write(LogLevel::Info, happening.what, {{"user", user}, {"layer", layer}});
    else
        log_.write(LogLevel::Info, happening.what,
                   {{"user", user}, {"layer", layer}, {"detail", happening.detail}});
}

void ServerHost::forgetClientsIn(milliseconds pause) {
    clientsTimer_.expires_after(pause);
    clientsTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        std::set<ClientId> kept;
        guarded([&] {
            if (project_) kept = project_->activeClients();
        });
        asio::post(workers_.history, [this, kept = std::move(kept)] {
            const auto forgotten = store_.use(
                [&](CommitStore& store) { return store.forgetClients(kKnownClients, kept); });
            if (forgotten && *forgotten > 0)
                log_.write(LogLevel::Info, "clients forgotten", {{"clients", *forgotten}});
            asio::post(network_, [this] { forgetClientsIn(kForgetPause); });
        });
    });
}

// --- How far back the history goes

CommitStore::GoesOn ServerHost::whileServing() const {
    return [this] {
        faultPoint("keeping");
        return !stopping_;
    };
}

void ServerHost::findBase(std::int64_t beforeMs, Revision upTo) {
    inBackground(
        checkpoints_, 0, 0,
        [this, beforeMs, upTo] {
            return store_.use(
                [&](CommitStore& store) { return server::findBase(store, beforeMs, upTo); });
        },
        [](Project& project, Result<BaseLimit> limit) { project.baseFound(std::move(limit)); });
}

void ServerHost::compact(Revision revision) {
    inBackground(
        keeper_, 0, 0,
        [this, revision] {
            auto outcome = compactStore(revision);
            // Also a project that was made meanwhile has to know.
            const auto base = store_.use(
                [](CommitStore& store) -> Result<CommitStore::Base> { return store.base(); });
            if (base) onProject([base](Project& project) { project.baseIs(*base); });
            return outcome;
        },
        [](Project& project, const Result<CompactOutcome>& outcome) {
            project.compacted(outcome);
        });
}

Result<CompactOutcome> ServerHost::compactStore(Revision revision) {
    const auto begin = steady_clock::now();
    const auto outcome = store_.use([&](CommitStore& store) -> Result<CompactOutcome> {
        faultPoint("compact-before");
        const auto before = store.space();
        if (!before) return tl::unexpected(before.error());
        const auto done = store.compact(revision, whileServing());
        if (!done) return tl::unexpected(done.error());
        faultPoint("compact-after");
        return store.space().map(
            [&](const StoreSpace& after) { return CompactOutcome{before->log, after.log}; });
    });
    if (!outcome) {
        log_.write(LogLevel::Warning, "history not compacted",
                   {{"revision", revision}, {"error", outcome.error().message}});
        return outcome;
    }
    const auto time = std::chrono::duration_cast<milliseconds>(steady_clock::now() - begin);
    log_.write(LogLevel::Info, "history compacted",
               {{"revision", revision},
                {"bytesBefore", outcome->bytesBefore},
                {"bytesAfter", outcome->bytesAfter},
                {"ms", time.count()}});
    return outcome;
}

void ServerHost::measureStorage(SessionId session, std::uint64_t request) {
    inBackground(
        keeper_, session, Intake::kJobBytes,
        [this] {
            return store_.use([&](CommitStore& store) {
                return server::measureStorage(store, files_.folder / ".usdlive" / "blobs",
                                              whileServing());
            });
        },
        [session, request](Project& project, Result<Storage> storage) {
            project.storageMeasured(session, request, std::move(storage));
        });
}

void ServerHost::boundHistoryIn(milliseconds pause) {
    historyTimer_.expires_after(pause);
    historyTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        guarded([&] {
            if (project_) project_->boundHistory();
        });
        boundHistoryIn(kHistoryPause);
    });
}

// --- The project itself

/// Everybody has to come again. What the project before had handed to the store is kept.
void ServerHost::startAgain() {
    project_.reset();
    ++generation_;
    closeAll(Error{ErrorCode::Internal, std::string(errorText(ErrorCode::Internal))});
    storage_.flush([this] {
        asio::post(network_, [this] {
            for (const auto& [revision, bytes] : std::exchange(appending_, {}))
                intake_.endStore(bytes);
            storage_.goOn();
            makeProjectAgain();
        });
    });
}

void ServerHost::makeProject(ProjectBeginning beginning) {
    project_ = std::make_unique<Project>(setup_.options, ports(), std::move(beginning.store),
                                         beginning.files);
}

void ServerHost::makeProjectAgain() {
    asio::post(workers_.joins, [this] {
        auto beginning = resultOf(setup_.read);
        asio::post(network_, [this, beginning = std::move(beginning)]() mutable {
            if (beginning) {
                makeProject(std::move(*beginning));
                return log_.write(LogLevel::Warning, "project started again");
            }
            log_.write(LogLevel::Error, "project cannot start again",
                       {{"error", beginning.error().message}});
            retryTimer_.expires_after(kRetryPause);
            retryTimer_.async_wait([this](const boost::system::error_code& error) {
                if (!error) makeProjectAgain();
            });
        });
    });
}

// Polled: the folder may be on a share, whose changes no system call tells.
void ServerHost::scanFilesIn(milliseconds pause) {
    scanTimer_.expires_after(pause);
    scanTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        asio::post(workers_.files, [this] {
            const auto begin = steady_clock::now();
            auto files = resultOf(files_.list);
            const auto time = std::chrono::duration_cast<milliseconds>(steady_clock::now() - begin);
            asio::post(network_, [this, time, files = std::move(files)]() mutable {
                filesScanned(std::move(files), time);
            });
        });
    });
}

void ServerHost::sweepSoon() {
    if (sweeping_ || !project_ || !project_->hasPresence()) return;
    sweeping_ = true;
    sweepTimer_.expires_after(milliseconds(Project::kSweepMs));
    sweepTimer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        sweeping_ = false;
        const auto now =
            std::chrono::duration_cast<milliseconds>(steady_clock::now().time_since_epoch());
        guarded([&] {
            if (project_) project_->sweep(now.count());
        });
        sweepSoon();
    });
}

void ServerHost::filesScanned(Result<std::vector<LayerFile>> files, milliseconds time) {
    scanFilesIn(std::max(kScanPause, time * kScanPart));
    guarded([&] {
        if (project_) project_->unloadIdle();
    });
    if (!files || *files == scanned_) return;
    scanned_ = std::move(*files);
    guarded([&] {
        if (project_) project_->setFiles(scanned_);
    });
}

}  // namespace usdlive::server
