// Connects a project with its store, the storage thread and workers.
#include "app/StoreHistory.h"

#include <chrono>
#include <utility>

#include "app/Faults.h"
#include "app/StorageUse.h"

namespace usdlive::server {

namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

// A session gets at most this many bytes of old commits in one read. The rest is requested later.
constexpr std::size_t kReadBytes = 16 * 1024 * 1024;

}  // namespace

StoreHistory::StoreHistory(ProjectStrand& strand, Intake& intake, WorkerShares& workers,
                           SharedStore& store, StorageThread& storage,
                           std::filesystem::path blobFolder, Log& log)
    : strand_(strand),
      intake_(intake),
      workers_(workers),
      checkpoints_(workers.history),
      snapshotWriter_(workers.history),
      keeper_(workers.keeper),
      store_(store),
      storage_(storage),
      blobFolder_(std::move(blobFolder)),
      log_(log) {}

void StoreHistory::appended(Revision upTo) {
    while (!appending_.empty() && appending_.begin()->first <= upTo)
        intake_.endStore(appending_.extract(appending_.begin()).mapped());
}

void StoreHistory::dropped() {
    for (const auto& [revision, bytes] : std::exchange(appending_, {})) intake_.endStore(bytes);
}

void StoreHistory::append(CommitRecord commit) {
    std::size_t bytes = Intake::kJobBytes / 64;
    if (commit.frame) bytes += commit.frame->size();
    intake_.beginStore(bytes);
    appending_[commit.revision] = bytes;
    storage_.append(std::move(commit));
}

void StoreHistory::keepSnapshot(const LayerId& layer, LayerDoc doc, Revision revision,
                                const Hash& hash) {
    strand_.inBackground(
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

void StoreHistory::loadLayer(const LayerId& layer) {
    strand_.inBackground(
        *workers_.joins, 0, 0, [this, layer] { return loadStored(layer); },
        [layer](Project& project, Result<std::optional<LoadedLayer>> stored) {
            if (!stored) return project.layerLoaded(layer, tl::unexpected(stored.error()));
            if (*stored) return project.layerLoaded(layer, std::move(**stored));
            project.layerNotStored(layer);
        });
}

Result<std::optional<LoadedLayer>> StoreHistory::loadStored(const LayerId& layer) {
    Replayed replayed;
    auto stored = store_.use([&](CommitStore& store) { return store.loadLayer(layer, &replayed); });
    if (!stored) return tl::unexpected(stored.error());
    if (!*stored) return std::nullopt;
    auto saved = store_.use([&](CommitStore& store) { return store.saved(layer); });
    if (!saved) return tl::unexpected(saved.error());
    return LoadedLayer{std::move(**stored), {}, std::move(*saved), replayed};
}

void StoreHistory::readCommits(SessionId session, Revision from, Revision to) {
    strand_.inBackground(
        *workers_.joins, session, Intake::kJobBytes,
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

void StoreHistory::readHistory(SessionId session, std::uint64_t request, const LayerId& layer,
                               Revision revision) {
    strand_.inBackground(
        *workers_.history, session, Intake::kJobBytes,
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

void StoreHistory::readClient(const ClientId& client) {
    strand_.inBackground(
        *workers_.joins, 0, 0,
        [this, client] {
            return store_.use([&](CommitStore& store) { return store.clientRecord(client); });
        },
        [client](Project& project, const Result<ClientRecord>& record) {
            project.clientRead(client, record);
        });
}

void StoreHistory::addCheckpoint(SessionId session, std::uint64_t request,
                                 const Checkpoint& checkpoint) {
    strand_.inBackground(
        checkpoints_, session, Intake::kJobBytes,
        [this, checkpoint] {
            return store_.use([&](CommitStore& store) { return store.addCheckpoint(checkpoint); })
                .map([&] { return checkpoint; });
        },
        [session, request](Project& project, const Result<Checkpoint>& added) {
            project.checkpointAdded(session, request, added);
        });
}

void StoreHistory::readCheckpoints(SessionId session, std::uint64_t request) {
    strand_.inBackground(
        checkpoints_, session, Intake::kJobBytes,
        [this] { return store_.use([](CommitStore& store) { return store.checkpoints(); }); },
        [session, request](Project& project, Result<std::vector<Checkpoint>> read) {
            project.checkpointsRead(session, request, std::move(read));
        });
}

void StoreHistory::findBase(std::int64_t beforeMs, Revision upTo) {
    strand_.inBackground(
        checkpoints_, 0, 0,
        [this, beforeMs, upTo] {
            return store_.use(
                [&](CommitStore& store) { return server::findBase(store, beforeMs, upTo); });
        },
        [](Project& project, Result<BaseLimit> limit) { project.baseFound(std::move(limit)); });
}

void StoreHistory::compact(Revision revision) {
    strand_.inBackground(
        keeper_, 0, 0,
        [this, revision] {
            auto outcome = compactStore(revision);
            // A project that was created meanwhile needs to know, too.
            const auto base = store_.use(
                [](CommitStore& store) -> Result<CommitStore::Base> { return store.base(); });
            if (base) strand_.post([base](Project& project) { project.baseChanged(*base); });
            return outcome;
        },
        [](Project& project, const Result<CompactOutcome>& outcome) {
            project.compacted(outcome);
        });
}

Result<CompactOutcome> StoreHistory::compactStore(Revision revision) {
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

void StoreHistory::measureStorage(SessionId session, std::uint64_t request) {
    strand_.inBackground(
        keeper_, session, Intake::kJobBytes,
        [this] {
            return store_.use([&](CommitStore& store) {
                return server::measureStorage(store, blobFolder_, whileServing());
            });
        },
        [session, request](Project& project, Result<Storage> storage) {
            project.storageMeasured(session, request, std::move(storage));
        });
}

CommitStore::KeepRunning StoreHistory::whileServing() const {
    return [this] {
        faultPoint("keeping");
        return !stopping_;
    };
}

}  // namespace usdlive::server
