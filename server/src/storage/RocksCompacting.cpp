// Replaces old commits by a base: the content of the layers at that revision.
#include <rocksdb/convenience.h>
#include <unistd.h>

#include "storage/RocksCommitStoreImpl.h"
#include "storage/StoreRules.h"

namespace usdlive::server {

namespace {

const tl::unexpected<Error> kEnded =
    fail(ErrorCode::ShuttingDown, "compaction was cancelled; no commits were removed");

}  // namespace

/// Nothing refers to the new files until one record is written. From then on nothing reads the old
/// data, which is removed afterwards or at the next opening.
Result<void> RocksCommitStore::compact(Revision revision, const KeepRunning& wanted) {
    const std::lock_guard alone(compactMutex_);
    // Stops if the store has failed, because reopening it waits for this.
    const KeepRunning keepRunning = [&] { return wanted() && checkFailed(); };
    if (revision <= base().revision) return isRemoved() ? Result<void>() : removeReplaced();
    const auto hash = hashAt(revision);
    if (!hash) return tl::unexpected(hash.error());
    const Base to{revision, *hash};
    if (const auto verified = verifyReplaced(revision, keepRunning); !verified) return verified;

    Layers known;
    {
        const std::shared_lock lock(mutex_);
        known = layers_;
    }
    rocksdb::WriteBatch batch;
    std::map<LayerId, LayerBase> made;
    const auto makeAll = [&]() -> Result<void> {
        for (const auto& [name, layer] : known) {
            const auto base = makeBase(name, layer, to, keepRunning);
            if (!base) return tl::unexpected(base.error());
            if (!*base) continue;
            made[name] = **base;
            batch.Put(family(Family::Meta), key(kLayerBasePrefix, layer.number),
                      slice(encoded((*base)->revision, (*base)->content)));
        }
        batch.Put(family(Family::Meta), kBaseKey, slice(encoded(to.revision, to.hash)));
        return checkFailed()
            .and_then([&] { return checkSpace(batch.GetDataSize()); })
            .and_then([&] { return write(batch, true); });
    };
    if (const auto done = makeAll(); !done) {
        // Only reopening shows whether the record was written; it also removes unneeded files.
        if (checkFailed()) removeStrayBases();
        return done;
    }
    {
        const std::unique_lock lock(mutex_);
        base_ = to;
        for (const auto& [name, base] : made) layers_[name].base = base;
    }
    const auto removed = removeReplaced();
    if (!removed) return removed;
    rocksdb::CompactRangeOptions options;
    options.exclusive_manual_compaction = false;
    const std::string first = storekeys::commit(0), last = storekeys::commit(to.revision);
    const rocksdb::Slice from(first), end(last);
    // If there is no room for this now, RocksDB does it later.
    db_->CompactRange(options, family(Family::Commits), &from, &end).PermitUncheckedError();
    (void)measureSpace();
    return {};
}

/// Data that cannot be read or breaks the chain is not replaced, so that it can be examined.
Result<void> RocksCommitStore::verifyReplaced(Revision to, const KeepRunning& keepRunning) const {
    bool ended = false;
    const auto read = this->read(0, to, [&](const StoredCommit&) {
        ended = !keepRunning();
        return !ended;
    });
    if (!read) return read;
    if (ended) return kEnded;
    return {};
}

Result<std::optional<RocksCommitStore::LayerBase>> RocksCommitStore::makeBase(
    const LayerId& layer, const Layer& known, const Base& to, const KeepRunning& keepRunning) {
    const Base before = base();
    auto runs = runsAfter(known.number, before.revision);
    if (!runs) return tl::unexpected(runs.error());
    std::erase_if(*runs, [&](const Run& run) { return run.first > to.revision; });
    if (runs->empty()) return std::optional<LayerBase>();
    runs->back().last = std::min(runs->back().last, to.revision);

    auto found = readBaseOf(layer, before);
    if (!found) return tl::unexpected(found.error());
    LayerSnapshot made{to.revision, to.hash, *found ? std::move((*found)->doc) : LayerDoc()};
    if (const auto followed = follow(made.doc, layer, *runs, keepRunning); !followed)
        return tl::unexpected(followed.error());
    const Bytes content = encodeSnapshot(made);
    if (const Space space = measureSpace(); space.usable < space.least + kCopies * content.size())
        return fail(ErrorCode::StorageFull, "too little space for the base of " + layer.value);
    const auto path = folder_.base(known.number, to.revision);
    if (auto done = checkedfile::replace(path, content); !done) return tl::unexpected(done.error());
    const auto written = checkedfile::read(path);
    const auto again = written ? decodeSnapshot(*written) : std::nullopt;
    if (!again || again->revision != made.revision || again->hash != made.hash ||
        !(again->doc == made.doc))
        return fail(ErrorCode::StorageFailed,
                    "the base of " + layer.value + " at revision " + std::to_string(to.revision) +
                        " was written but cannot be read back from " + path.string());
    return std::optional(LayerBase{to.revision, sha256(content)});
}

bool RocksCommitStore::isRemoved() const {
    const Revision base = this->base().revision;
    if (base == 0) return true;
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Commits)));
    at->SeekToFirst();
    return !at->Valid() || storekeys::bigEndian64(text(at->key())) > base;
}

/// Removes the commits last. While some are left, this is repeated at the next opening.
Result<void> RocksCommitStore::removeReplaced() {
    // Removing whole files is not recorded in the log, so the new base has to be in the tables
    // first.
    auto status = db_->Flush(rocksdb::FlushOptions(), handles_);
    if (!status.ok()) return tl::unexpected(error(status, "write to"));
    if (auto done = removeReplacedRecords(); !done) return done;
    removeStrayBases();
    removeOldSnapshots();
    const std::string first = storekeys::commit(0), end = storekeys::commit(base().revision + 1);
    const rocksdb::Slice from(first), to(end);
    // Removes whole files, which frees space even if too little is left for merging tables.
    const rocksdb::RangePtr range(&from, &to);
    status = rocksdb::DeleteFilesInRanges(db_.get(), family(Family::Commits), &range, 1, false);
    if (!status.ok()) return tl::unexpected(error(status, "take commits out of"));
    return removeCommitsBefore(end);
}

/// Deletes one by one, because RocksDB 7.8 searches the place of a deleted range with the hints of
/// single keys, which this family uses, and aborts. Without sync: unfinished work is repeated.
Result<void> RocksCommitStore::removeCommitsBefore(const std::string& end) {
    constexpr std::uint32_t kAtOnce = 1'000;
    rocksdb::ReadOptions options;
    options.fill_cache = false;
    const std::unique_ptr<rocksdb::Iterator> at(db_->NewIterator(options, family(Family::Commits)));
    rocksdb::WriteBatch batch;
    const auto writeOut = [&] {
        auto done = checkSpace(batch.GetDataSize()).and_then([&] { return write(batch, false); });
        batch.Clear();
        return done;
    };
    for (at->SeekToFirst(); at->Valid() && text(at->key()) < end; at->Next()) {
        batch.Delete(family(Family::Commits), at->key());
        if (batch.Count() < kAtOnce) continue;
        if (auto done = writeOut(); !done) return done;
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return writeOut();
}

/// Removes the moves and deletes that nobody needs any more, and the runs of commits before the one
/// that includes the base. Keeps the last run of a layer, because it tells when the layer was
/// changed last.
Result<void> RocksCommitStore::removeReplacedRecords() {
    const Revision base = this->base().revision, newest = head().revision;
    rocksdb::WriteBatch batch;
    std::string previous;  // key of a run that begins at or before the base
    const auto read = each(kEditedPrefix, {}, [&](std::string_view run, ByteView) {
        constexpr std::size_t kNumberBytes = sizeof(std::uint32_t);
        if (run.size() != kNumberBytes + sizeof(Revision)) return false;
        if (storekeys::bigEndian64(run.substr(kNumberBytes)) > base) return true;
        if (previous.substr(0, kNumberBytes) == run.substr(0, kNumberBytes))
            batch.Delete(family(Family::Meta), key(kEditedPrefix, previous));
        previous = run;
        return true;
    });
    if (!read) return read;
    if (newest > kNamespaceLogRevisions)
        batch.DeleteRange(
            family(Family::Meta), key(kNamespacePrefix, Revision(0)),
            key(kNamespacePrefix, std::min(base, newest - kNamespaceLogRevisions) + 1));
    return write(batch);
}

/// Removes files that no record refers to: of an earlier base, or of an unfinished one. A file that
/// cannot be removed only takes space.
void RocksCommitStore::removeStrayBases() {
    std::set<std::string> wanted;
    {
        const std::shared_lock lock(mutex_);
        for (const auto& [name, layer] : layers_)
            wanted.insert(folder_.base(layer.number, layer.base.revision).filename().string());
    }
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.bases(), ignored))
        if (!wanted.contains(entry.path().filename().string())) ::unlink(entry.path().c_str());
}

/// Removes snapshots older than the base, which replaces them.
void RocksCommitStore::removeOldSnapshots() {
    std::vector<std::uint32_t> numbers;
    {
        const std::shared_lock lock(mutex_);
        for (const auto& [name, layer] : layers_) numbers.push_back(layer.number);
    }
    const Revision base = this->base().revision;
    for (const std::uint32_t number : numbers) {
        const std::lock_guard lock(snapshotMutex_);
        for (const Revision older : olderSnapshots(number))
            if (older < base) removeSnapshot(number, older);
        const auto path = folder_.snapshot(number);
        const auto revision = snapshotRevision(path);
        if (!revision || *revision >= base) continue;
        ::unlink(path.c_str());
        snapshots_.erase(number);
    }
}

void RocksCommitStore::removeSnapshot(std::uint32_t layer, Revision revision) {
    const std::lock_guard lock(olderMutex_);
    older_[layer].erase(revision);
    ::unlink(folder_.snapshot(layer, revision).c_str());
}

}  // namespace usdlive::server
