// Appends commits and snapshots to the store.
#include <algorithm>
#include <cstdio>

#include "storage/RocksCommitStoreImpl.h"
#include "storage/StoreRules.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kKnownClients = 10'000;
constexpr std::size_t kRecordBytes = 256;  // estimated size of a commit without its frame
constexpr std::uint64_t kLongLogBytes = 4 * kMib;

}  // namespace

CommitStore::Head RocksCommitStore::head() const {
    const std::shared_lock lock(mutex_);
    return head_;
}

CommitStore::Base RocksCommitStore::base() const {
    const std::shared_lock lock(mutex_);
    return base_;
}

Result<void> RocksCommitStore::append(std::span<const CommitRecord> commits) {
    if (commits.empty()) return {};
    const std::lock_guard clientsLock(clientsMutex_);
    const auto ready = checkFailed().and_then([&] { return checkThere(); }).and_then([&] {
        return mayAppend(commits, head_);
    });
    if (!ready) return ready;
    std::size_t bytes = 0;
    for (const CommitRecord& commit : commits)
        bytes += std::min(commit.frame->size(), kBigFrame) + kRecordBytes;

    Group group(bytes);
    group.head = head_;
    for (const CommitRecord& commit : commits)
        if (const auto added = addTo(group, commit); !added) return added;
    addFound(group);
    addHead(group);
    // A write to files that were deleted meanwhile succeeds but is lost, so checkThere() follows.
    const auto written = checkSpace(group.batch.GetDataSize())
                             .and_then([&] { return write(group.batch); })
                             .and_then([&] { return checkThere(); });
    if (!written) return written;

    if (options_.durability == Durability::Synced)
        folder_.setMark({group.head.revision, group.head.hash});
    if (highest_.size() > kKnownClients) highest_.clear();
    for (const auto& [client, highest] : group.clients) highest_[client] = highest;
    const std::unique_lock lock(mutex_);
    head_ = group.head;
    for (auto& [name, layer] : group.layers) {
        // setSaved() may have been called meanwhile.
        Layer& known = layers_[name];
        const bool isNew = group.saved.contains(name);
        if (!isNew || known.saved.revision > layer.saved.revision) layer.saved = known.saved;
        layer.base = known.base;  // compact() may have changed it
        known = layer;
    }
    if (group.batch.GetDataSize() > kLongLogBytes) flushSoon();
    return {};
}

/// Starts writing the log of RocksDB to tables in the background, so that the next opening has less
/// log to replay.
void RocksCommitStore::flushSoon() {
    rocksdb::FlushOptions options;
    options.wait = false;
    db_->Flush(options, handles_).PermitUncheckedError();
}

Result<void> RocksCommitStore::addTo(Group& group, const CommitRecord& commit) {
    addRecord(group, commit);
    for (const LayerId& name : commit.layers) addEdited(group, name, commit.revision);
    if (commit.saved) {
        Layer& layer = layerOf(group, commit.saved->layer);
        if (commit.saved->state.revision >= layer.saved.revision) layer.saved = commit.saved->state;
        group.saved.insert(commit.saved->layer);
    }
    if (!commit.namespaceChanges.empty())
        group.batch.Put(family(Family::Meta), key(kNamespacePrefix, commit.revision),
                        slice(encoded(commit.namespaceChanges)));
    group.head.revision = commit.revision;
    group.head.hash = commit.hash;
    return addTransaction(group, commit.id, commit.revision);
}

/// Extends the last run of commits if the next commit of the layer is close enough, otherwise
/// starts a run.
void RocksCommitStore::addEdited(Group& group, const LayerId& name, Revision revision) {
    Layer& layer = layerOf(group, name);
    if (layer.changed == revision) return;
    if (layer.changed == 0 || revision > layer.changed + kSmallGap) layer.runBegin = revision;
    layer.changed = revision;
    group.runs[{name, layer.runBegin}] = revision;
}

void RocksCommitStore::addRecord(Group& group, const CommitRecord& commit) {
    const std::string revision = storekeys::commit(commit.revision);
    const rocksdb::Slice keys[] = {revision};
    Bytes storage;
    const ByteView record = recordOf(*commit.frame, storage);
    const rocksdb::Slice values[] = {slice(commit.hash.bytes), slice(record)};
    group.batch.Put(family(Family::Commits), {keys, 1}, {values, 2});
}

// Only this thread adds layers, so finding one needs no lock.
RocksCommitStore::Layer& RocksCommitStore::layerOf(Group& group, const LayerId& name) {
    const auto [entry, added] = group.layers.try_emplace(name);
    if (!added) return entry->second;
    if (const auto known = layers_.find(name); known != layers_.end()) {
        const std::shared_lock lock(mutex_);  // setSaved() may write it
        return entry->second = known->second;
    }
    // Layers are never removed, so their count is the highest number.
    std::uint32_t number = std::uint32_t(layers_.size());
    for (const auto& [other, layer] : group.layers) number = std::max(number, layer.number);
    entry->second.number = number + 1;
    group.batch.Put(family(Family::Meta), key(kLayerPrefix, name.value),
                    slice(encoded<std::uint32_t>(number + 1)));
    return entry->second;
}

Result<void> RocksCommitStore::addTransaction(Group& group, const TransactionId& id,
                                              Revision revision) {
    if (id.sequence == 0) return {};  // an import or a reload is never sent again
    const auto [entry, added] = group.clients.try_emplace(id.client);
    if (added) {
        const auto known = highest_.find(id.client);
        const auto last = known == highest_.end() ? lastSequence(id.client) : known->second;
        if (!last) return tl::unexpected(last.error());
        entry->second = *last;
    }
    const bool late = entry->second >= id.sequence + kRemembered;
    entry->second = std::max(entry->second, id.sequence);
    Bytes value = encoded<std::uint64_t>(id.sequence);
    appendNumber<Revision>(value, revision);
    const std::string key = late ? storekeys::lateTransaction(id.client, id.sequence)
                                 : storekeys::transaction(id.client, id.sequence);
    group.batch.Put(family(Family::Clients), key, slice(value));
    return {};
}

/// Adds the records of layers and clients that the group's commits change.
void RocksCommitStore::addFound(Group& group) {
    for (const auto& [client, end] : group.clients)
        group.batch.Put(family(Family::Clients), storekeys::highestTransaction(client),
                        slice(encoded<std::uint64_t>(end)));
    for (const auto& [run, last] : group.runs)
        group.batch.Put(family(Family::Meta),
                        key(kEditedPrefix, group.layers.at(run.first).number, run.second),
                        slice(encoded<Revision>(last)));
    for (const LayerId& name : group.saved) {
        const Layer& layer = group.layers.at(name);
        const std::shared_lock lock(mutex_);  // setSaved() may write it
        const auto known = layers_.find(name);
        if (known == layers_.end() || layer.saved.revision >= known->second.saved.revision)
            group.batch.Put(family(Family::Meta), key(kSavedPrefix, layer.number),
                            slice(encodedSaved(layer.saved)));
    }
}

void RocksCommitStore::addHead(Group& group) {
    group.batch.Put(family(Family::Meta), kHeadKey,
                    slice(encoded(group.head.revision, group.head.hash)));
    group.batch.Put(family(Family::Clients), kClientsRevisionKey,
                    slice(encoded<Revision>(group.head.revision)));
}

Result<void> RocksCommitStore::write(rocksdb::WriteBatch& batch, bool synced) {
    rocksdb::WriteOptions options;
    options.sync = synced;
    auto status = db_->Write(options, &batch);
    // RocksDB writes nothing after its tables found the disk or their limit full.
    const auto areTablesFull = [&] { return isFull(status) && !background_->hasWriteFailed(); };
    if (areTablesFull()) {
        background_->setStopped();
        (void)measureSpace();
        if (!background_->hasStopped()) status = db_->Write(options, &batch);
    }
    if (status.ok()) return {};
    if (areTablesFull())
        return fail(ErrorCode::StorageFull, "the disk of the store " + folder_.path().string() +
                                                " is too full for its tables. Free some space");
    // A part may be on the disk. Only reopening the store shows it, so there is no second attempt.
    Error failure = error(status, "write to");
    failure.code = ErrorCode::StorageFailed;
    const std::unique_lock lock(mutex_);
    failure_ = failure;
    return tl::unexpected(std::move(failure));
}

Result<void> RocksCommitStore::checkFailed() const {
    const std::shared_lock lock(mutex_);
    if (failure_) return tl::unexpected(*failure_);
    return {};
}

Result<void> RocksCommitStore::checkThere() const {
    if (folder_.isThere()) return {};
    return fail(ErrorCode::StorageFailed,
                "the store " + folder_.path().string() +
                    " was deleted, moved or replaced while the server runs");
}

/// Keeps the newest snapshot as an older one when `next` replaces it, so that reading an old
/// revision need not start at the base. If there are too many, removes the one with the closest
/// neighbours, which keeps them spread over the history.
void RocksCommitStore::keepOlder(std::uint32_t layer, Revision next) {
    constexpr std::size_t kOlder = 6;
    const auto newest = folder_.snapshot(layer);
    const auto revision = snapshotRevision(newest);
    if (!revision || *revision >= next) return;
    if (::rename(newest.c_str(), folder_.snapshot(layer, *revision).c_str()) != 0) return;
    std::set<Revision> all;
    {
        const std::lock_guard lock(olderMutex_);
        all = older_[layer];
        all.insert(*revision);
        older_[layer] = all;
    }
    while (all.size() > kOlder) {
        Revision least = ~Revision(0), dropped = 0, before = base().revision;
        for (auto at = all.begin(); at != all.end(); before = *at++) {
            const Revision after = std::next(at) == all.end() ? next : *std::next(at);
            if (after - before < least) {
                least = after - before;
                dropped = *at;
            }
        }
        all.erase(dropped);
        removeSnapshot(layer, dropped);
    }
}

Result<std::size_t> RocksCommitStore::keepSnapshot(const LayerId& layer, const LayerDoc& doc,
                                                   Revision revision, const Hash& hash) {
    const std::uint32_t number = numberOf(layer);
    if (number == 0) return fail(ErrorCode::LayerNotFound, "the store has no layer " + layer.value);
    const auto known = hashAt(revision);
    if (!known) return tl::unexpected(known.error());
    if (revision == 0 || *known != hash)
        return fail(ErrorCode::HistoryDiverged,
                    "the snapshot of " + layer.value + " belongs to another history");
    const std::lock_guard lock(snapshotMutex_);
    auto& [newest, size] = snapshots_[number];
    if (revision <= newest) return size;
    // The snapshot needs its space beside the previous one for a while. Space for edits comes
    // first.
    const auto fits = [this](std::size_t bytes) {
        const Space space = measureSpace();
        return space.usable >= 2 * space.least + kCopies * bytes;
    };
    const auto full = [&] {
        return fail(ErrorCode::StorageFull, "too little space for a snapshot of " + layer.value);
    };
    if (!fits(size)) return full();
    const Bytes content = encodeSnapshot({revision, hash, doc});
    if (!fits(content.size()))
        for (const Revision older : olderSnapshots(number)) removeSnapshot(number, older);
    if (!fits(content.size())) return full();
    keepOlder(number, revision);
    if (auto done = checkedfile::replace(folder_.snapshot(number), content); !done)
        return tl::unexpected(done.error());
    newest = revision;
    return size = content.size();
}

}  // namespace usdlive::server
