// Reads commits, layers and checkpoints from the store.
#include "storage/RocksCommitStoreImpl.h"
#include "storage/StoreRules.h"

namespace usdlive::server {

Result<void> RocksCommitStore::each(
    char prefix, const std::string& start,
    const std::function<bool(std::string_view, ByteView)>& visit) const {
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Meta)));
    for (at->Seek(key(prefix, start)); at->Valid() && text(at->key()).front() == prefix; at->Next())
        if (!visit(text(at->key()).substr(1), bytes(at->value())))
            return damaged(std::string("a record of kind ") + prefix + " cannot be read");
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return {};
}

std::optional<StoredCommit> RocksCommitStore::commitAt(const rocksdb::Iterator& at) const {
    const ByteView value = bytes(at.value());
    if (at.key().size() != sizeof(Revision) || value.size() < kHashBytes + kFrameLengthBytes)
        return std::nullopt;
    SharedBytes frame = frameOf(value.subspan(kHashBytes));
    if (!frame) return std::nullopt;
    return StoredCommit{storekeys::bigEndian64(text(at.key())), std::move(frame), hashOf(value)};
}

Result<void> RocksCommitStore::read(Revision from, Revision to,
                                    const std::function<bool(const StoredCommit&)>& visit) const {
    const Base first = base();
    Revision next = from == 0 ? first.revision + 1 : from;
    const Revision last = std::min(to, head().revision);
    if (next > last) return {};
    if (next <= first.revision) return historyReplaced(next, first.revision);
    auto before = hashAt(next - 1);
    if (!before) return tl::unexpected(before.error());
    rocksdb::ReadOptions options;
    options.fill_cache = false;
    const std::unique_ptr<rocksdb::Iterator> at(db_->NewIterator(options, family(Family::Commits)));
    for (at->Seek(storekeys::commit(next)); at->Valid() && next <= last; at->Next(), ++next) {
        const auto commit = commitAt(*at);
        if (!commit || commit->revision != next) break;
        if (chainHash(*before, withoutLength(*commit->frame)) != commit->hash)
            return damagedAt(next, "breaks the hash chain");
        before = commit->hash;
        if (!visit(*commit)) return {};
    }
    if (next > last) return {};
    if (!at->status().ok())
        return damagedAt(next, ("cannot be read: " + at->status().ToString()).c_str());
    return missing(next);
}

tl::unexpected<Error> RocksCommitStore::missing(Revision revision) const {
    if (const Revision first = base().revision; revision <= first)
        return historyReplaced(revision, first);
    return damagedAt(revision, "is missing or out of its place");
}

Result<Hash> RocksCommitStore::hashAt(Revision revision) const {
    const Base first = base();
    if (revision == first.revision) return first.hash;
    if (revision < first.revision) return historyReplaced(revision, first.revision);
    const Head newest = head();
    if (revision == newest.revision) return newest.hash;
    if (revision > newest.revision)
        return fail(ErrorCode::FutureRevision,
                    "there is no commit " + std::to_string(revision) + " yet");
    rocksdb::PinnableSlice value;
    const auto status = db_->Get(rocksdb::ReadOptions(), family(Family::Commits),
                                 storekeys::commit(revision), &value);
    if (!status.ok() && !status.IsNotFound())
        return damagedAt(revision, ("cannot be read: " + status.ToString()).c_str());
    if (!status.ok() || value.size() < kHashBytes) return missing(revision);
    return hashOf(bytes(value));
}

Result<std::vector<LayerId>> RocksCommitStore::layers() const {
    const std::shared_lock lock(mutex_);
    std::vector<LayerId> names;
    for (const auto& [name, layer] : layers_) names.push_back(name);
    return names;
}

std::uint32_t RocksCommitStore::numberOf(const LayerId& layer) const {
    const std::shared_lock lock(mutex_);
    const auto known = layers_.find(layer);
    return known == layers_.end() ? 0 : known->second.number;
}

Result<std::vector<RocksCommitStore::Run>> RocksCommitStore::runsAfter(std::uint32_t layer,
                                                                       Revision revision) const {
    std::vector<Run> runs;
    const std::string all = key(kEditedPrefix, layer);
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Meta)));
    const auto inside = [&] { return at->Valid() && text(at->key()).starts_with(all); };
    at->SeekForPrev(key(kEditedPrefix, layer, revision));  // the run may end after `revision`
    if (!inside()) at->Seek(all);
    for (; inside(); at->Next()) {
        const std::string_view first = text(at->key()).substr(all.size());
        const auto last = decoded<Revision>(bytes(at->value()));
        if (first.size() != sizeof(Revision) || !last)
            return damaged("a record of a layer's commits cannot be read");
        const Run run{std::max(storekeys::bigEndian64(first), revision + 1), *last};
        if (run.first > run.last) continue;
        if (!runs.empty() && run.first <= runs.back().last + kSmallGap)
            runs.back().last = run.last;
        else
            runs.push_back(run);
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return runs;
}

Result<std::size_t> RocksCommitStore::follow(LayerDoc& doc, const LayerId& layer,
                                             const std::vector<Run>& runs,
                                             const KeepRunning& keepRunning) const {
    std::size_t cost = 0;
    Result<void> followed;
    for (const auto& [first, last] : runs) {
        const auto done = read(first, last, [&](const StoredCommit& stored) {
            followed = decodeCommit(stored).and_then([&](const Commit& commit) -> Result<void> {
                if (!keepRunning())
                    return fail(ErrorCode::ShuttingDown, "reading the log was ended");
                cost += replayCost(stored.frame->size(), commit.edits.size());
                return replay(doc, layer, commit);
            });
            return bool(followed);
        });
        if (!done) return tl::unexpected(done.error());
        if (!followed) return tl::unexpected(followed.error());
    }
    return cost;
}

std::vector<Revision> RocksCommitStore::olderSnapshots(std::uint32_t layer) const {
    const std::lock_guard lock(olderMutex_);
    const auto known = older_.find(layer);
    if (known == older_.end()) return {};
    return {known->second.begin(), known->second.end()};
}

std::optional<LayerSnapshot> RocksCommitStore::readSnapshot(std::uint32_t layer,
                                                            Revision upTo) const {
    const auto newest = folder_.snapshot(layer);
    if (const auto revision = snapshotRevision(newest); revision && *revision <= upTo)
        if (auto found = readSnapshot(newest)) return found;
    const auto older = olderSnapshots(layer);
    for (auto revision = older.rbegin(); revision != older.rend(); ++revision)
        if (*revision <= upTo)
            if (auto found = readSnapshot(folder_.snapshot(layer, *revision))) return found;
    return std::nullopt;
}

std::optional<LayerSnapshot> RocksCommitStore::readSnapshot(
    const std::filesystem::path& path) const {
    const auto content = checkedfile::read(path);
    auto snapshot = content ? decodeSnapshot(*content) : std::nullopt;
    if (!snapshot) return std::nullopt;
    snapshot->bytes = content->size();
    const auto hash = hashAt(snapshot->revision);
    return hash && *hash == snapshot->hash ? std::move(snapshot) : std::nullopt;
}

Result<std::optional<LayerSnapshot>> RocksCommitStore::readBaseOf(const LayerId& layer,
                                                                  const Base& base) const {
    LayerBase of;
    std::uint32_t number = 0;
    {
        const std::shared_lock lock(mutex_);
        const auto known = layers_.find(layer);
        if (known == layers_.end()) return std::optional<LayerSnapshot>();
        of = known->second.base;
        number = known->second.number;
    }
    if (of.revision == 0) return std::optional<LayerSnapshot>();
    const auto path = folder_.base(number, of.revision);
    const auto content = checkedfile::read(path);
    auto found =
        content && sha256(*content) == of.content ? decodeSnapshot(*content) : std::nullopt;
    if (!found)
        return damaged("what " + layer.value + " held at revision " + std::to_string(of.revision) +
                       " cannot be read from " + path.string());
    found->bytes = content->size();
    found->revision = base.revision;
    found->hash = base.hash;
    return found;
}

Result<std::optional<LayerVersion>> RocksCommitStore::versionAt(const LayerId& layer,
                                                                Revision revision) const {
    for (;;) {
        const Base from = base();
        if (revision < from.revision) return historyReplaced(revision, from.revision);
        Layer known;
        {
            const std::shared_lock lock(mutex_);
            const auto found = layers_.find(layer);
            if (found == layers_.end()) return std::optional<LayerVersion>();
            known = found->second;
        }
        const auto last = known.changed <= revision
                              ? Result<Revision>(known.changed)
                              : lastChange(known.number, revision, known.base.revision != 0);
        if (!last) return tl::unexpected(last.error());
        if (*last <= from.revision) return LayerVersion{from.revision, from.hash};
        const auto hash = hashAt(*last);
        if (hash) return LayerVersion{*last, *hash};
        // The base may have moved meanwhile: tries again with the new one.
        if (from == base()) return tl::unexpected(hash.error());
    }
}

Result<Revision> RocksCommitStore::lastChange(std::uint32_t layer, Revision revision,
                                              bool hasBase) const {
    const std::string all = key(kEditedPrefix, layer);
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Meta)));
    const auto inside = [&] { return at->Valid() && text(at->key()).starts_with(all); };
    at->SeekForPrev(key(kEditedPrefix, layer, revision));
    const bool isBefore = inside();
    if (!isBefore && hasBase) return Revision(0);
    if (!isBefore) at->Seek(all);  // the layer was added after `revision`
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    if (!inside()) return Revision(0);
    const std::string_view first = text(at->key()).substr(all.size());
    const auto last = decoded<Revision>(bytes(at->value()));
    if (first.size() != sizeof(Revision) || !last)
        return damaged("a record of a layer's commits cannot be read");
    return isBefore ? std::min(*last, revision) : storekeys::bigEndian64(first);
}

Result<std::optional<LayerDoc>> RocksCommitStore::layerAt(const LayerId& layer, Revision revision,
                                                          Replayed* replayed) const {
    for (;;) {
        const Base from = base();
        auto found = layerFrom(from, layer, revision, replayed);
        // Files of an earlier base may have been removed during the read: tries again with the new
        // one.
        if (found || from == base()) return found;
    }
}

/// Replays the whole log if there is no snapshot.
Result<std::optional<LayerDoc>> RocksCommitStore::layerFrom(const Base& base, const LayerId& layer,
                                                            Revision revision,
                                                            Replayed* replayed) const {
    if (revision < base.revision) return historyReplaced(revision, base.revision);
    const std::uint32_t number = numberOf(layer);
    if (number == 0) return std::optional<LayerDoc>();
    auto from = readSnapshot(number, revision);
    if (!from) {
        auto first = readBaseOf(layer, base);
        if (!first) return tl::unexpected(first.error());
        from = std::move(*first);
    }
    auto runs = runsAfter(number, from ? from->revision : base.revision);
    if (!runs) return tl::unexpected(runs.error());
    // The first commit of a layer imported or created it.
    if (!from && !runs->empty()) revision = std::max(revision, runs->front().first);
    std::erase_if(*runs, [&](const Run& run) { return run.first > revision; });
    if (!runs->empty()) runs->back().last = std::min(runs->back().last, revision);
    const std::size_t begun = from ? from->bytes : 0;
    LayerDoc doc = from ? std::move(from->doc) : LayerDoc();
    const auto cost = follow(doc, layer, *runs, [] { return true; });
    if (!cost) return tl::unexpected(cost.error());
    if (replayed) *replayed = {begun, *cost};
    return std::optional(std::move(doc));
}

Result<SavedState> RocksCommitStore::saved(const LayerId& layer) const {
    const std::shared_lock lock(mutex_);
    const auto known = layers_.find(layer);
    return known == layers_.end() ? SavedState() : known->second.saved;
}

Result<void> RocksCommitStore::setSaved(const LayerId& layer, const SavedState& saved) {
    std::uint32_t number = 0;
    {
        const std::shared_lock lock(mutex_);
        const auto known = layers_.find(layer);
        if (known == layers_.end())
            return fail(ErrorCode::LayerNotFound, "the store holds no layer " + layer.value);
        number = known->second.number;
    }
    rocksdb::WriteBatch batch;
    batch.Put(family(Family::Meta), key(kSavedPrefix, number), slice(encodedSaved(saved)));
    const auto written =
        checkFailed().and_then([&] { return checkSpace(batch.GetDataSize()); }).and_then([&] {
            return write(batch);
        });
    if (!written) return written;
    const std::unique_lock lock(mutex_);
    layers_[layer].saved = saved;
    return {};
}

Result<std::vector<LayerId>> RocksCommitStore::unsavedLayers() const {
    const std::shared_lock lock(mutex_);
    std::vector<LayerId> names;
    for (const auto& [name, layer] : layers_)
        if (layer.changed > layer.saved.revision) names.push_back(name);
    return names;
}

Result<std::vector<NamespaceChange>> RocksCommitStore::namespaceChanges(Revision revision) const {
    std::vector<NamespaceChange> changes;
    const auto read = each(kNamespacePrefix, storekeys::commit(revision + 1),
                           [&](std::string_view key, ByteView value) {
                               return key.size() == sizeof(Revision) &&
                                      decodeInto(changes, storekeys::bigEndian64(key), value);
                           });
    if (!read) return tl::unexpected(read.error());
    return changes;
}

Result<std::uint64_t> RocksCommitStore::lastSequence(const ClientId& client) const {
    return number<std::uint64_t>(Family::Clients, storekeys::highestTransaction(client))
        .map([](const auto& last) { return last.value_or(0); });
}

Result<void> RocksCommitStore::addCheckpoint(const Checkpoint& checkpoint) {
    const std::string at = key(kCheckpointPrefix, checkpoint.name);
    std::string known;
    const auto status = db_->Get(rocksdb::ReadOptions(), family(Family::Meta), at, &known);
    if (!status.ok() && !status.IsNotFound()) return tl::unexpected(error(status, "read"));
    if (auto may = mayAdd(checkpoint, head().revision, status.ok()); !may) return may;
    rocksdb::WriteBatch batch;
    batch.Put(family(Family::Meta), at, slice(encodedCheckpoint(checkpoint)));
    return checkFailed().and_then([&] { return checkSpace(batch.GetDataSize()); }).and_then([&] {
        return write(batch);
    });
}

Result<std::vector<Checkpoint>> RocksCommitStore::checkpoints() const {
    std::vector<Checkpoint> all;
    const auto read = each(kCheckpointPrefix, {}, [&](std::string_view name, ByteView value) {
        auto checkpoint = decodedCheckpoint(name, value);
        if (checkpoint) all.push_back(std::move(*checkpoint));
        return checkpoint.has_value();
    });
    if (!read) return tl::unexpected(read.error());
    return all;
}

}  // namespace usdlive::server
