// Opens the store: locks the folder, opens the database and verifies its content.
#include <charconv>

#include "storage/RocksCommitStoreImpl.h"
#include "storage/StoreRules.h"

namespace usdlive::server {

namespace {

// The estimated space for opening, which writes the log to tables.
constexpr std::uint64_t kOpeningBytes = 2 * kMib;

}  // namespace

Result<void> RocksCommitStore::open() {
    return checkRoom()
        .and_then([this] { return openDatabase(); })
        .and_then([this] { return readIdentity(); })
        .and_then([this] { return readHead(); })
        .and_then([this] { return readBase(); })
        .and_then([this] { return readLayers(); })
        .and_then([this] { return verify(); })
        .and_then([this] { return folder_.takeFormat(); })
        .and_then([this] { return readEdited(); })
        .and_then([this] { return writeLogOut(); })
        .and_then([this] { return takeEpoch(); })
        .and_then([this] {
            removeStrayBases();
            findOlderSnapshots();
            return isRemoved() ? Result<void>() : removeReplaced();
        });
}

// Checks the space first, because RocksDB (as built by Debian) aborts when the disk is full.
Result<void> RocksCommitStore::checkRoom() {
    logBytes_ = logBytes(folder_.database());
    const std::uint64_t needed = 2 * logBytes_ + kOpeningBytes;
    reserve_.adapt(diskSpace(folder_.path()).free, needed, ~std::uint64_t(0));
    if (diskSpace(folder_.path()).free >= needed) return {};
    return fail(ErrorCode::StorageFull, "the disk is too full to open the store " +
                                            folder_.path().string() + ", which takes " +
                                            std::to_string(needed / kMib) + " MiB");
}

Result<void> RocksCommitStore::openDatabase() {
    rocksdb::DBOptions options = databaseOptions(files_);
    options.listeners.push_back(background_);
    // Never creates a database where commits were acknowledged.
    const auto mark = folder_.mark();
    options.create_if_missing = !mark || mark->revision == 0;
    auto families = columnFamilies();
    rocksdb::DB* opened = nullptr;
    const auto status =
        rocksdb::DB::Open(options, folder_.database().string(), families, &handles_, &opened);
    db_.reset(opened);
    // RocksDB syncs the files in its folder but not the folder's entry.
    if (status.ok()) return syncFolder(folder_.path());
    // RocksDB reports missing, short or foreign files with these two statuses.
    const bool broken = status.IsInvalidArgument() || status.IsPathNotFound();
    Error what = error(status, "open");
    if (broken) what.code = ErrorCode::StorageCorrupt;
    return tl::unexpected(std::move(what));
}

/// A store without an identity is a new one, or one of an earlier version. takeEpoch() writes it.
Result<void> RocksCommitStore::readIdentity() {
    const auto status =
        db_->Get(rocksdb::ReadOptions(), family(Family::Meta), kIdentityKey, &identity_.value);
    if (status.IsNotFound() || (status.ok() && options_.isNewLine))
        identity_.value = randomIdDigits();
    else if (!status.ok())
        return tl::unexpected(error(status, "read"));
    return {};
}

Result<void> RocksCommitStore::readHead() {
    const auto epoch = number<std::uint64_t>(Family::Meta, kEpochKey);
    if (!epoch) return tl::unexpected(epoch.error());
    head_.epoch = epoch->value_or(0);
    const auto forgotten = number<Revision>(Family::Meta, kForgottenKey);
    if (!forgotten) return tl::unexpected(forgotten.error());
    forgotten_ = forgotten->value_or(0);
    const auto head = readRevision(kHeadKey);
    if (!head) return tl::unexpected(head.error());
    if (*head) std::tie(head_.revision, head_.hash) = **head;
    return {};
}

Result<void> RocksCommitStore::readBase() {
    const auto base = readRevision(kBaseKey);
    if (!base) return tl::unexpected(base.error());
    if (*base) std::tie(base_.revision, base_.hash) = **base;
    if (base_.revision > head_.revision)
        return damagedAt(base_.revision, "is the base, and the history ends before it");
    if (base_.revision == head_.revision && base_.hash != head_.hash)
        return damagedAt(base_.revision, "is the base, and its hash is another than the newest's");
    return {};
}

Result<void> RocksCommitStore::readLayers() {
    std::map<std::uint32_t, LayerId> names;
    const auto read = each(kLayerPrefix, {}, [&](std::string_view name, ByteView value) {
        const auto number = decoded<std::uint32_t>(value);
        if (!number || !names.try_emplace(*number, LayerId{std::string(name)}).second) return false;
        layers_[{std::string(name)}].number = *number;
        return true;
    });
    if (!read) return read;
    for (auto& [name, layer] : layers_) {
        auto saved = readSaved(layer.number);
        if (!saved) return tl::unexpected(saved.error());
        layer.saved = std::move(*saved);
        const auto base = readRevision(key(kLayerBasePrefix, layer.number));
        if (!base) return tl::unexpected(base.error());
        if (*base) layer.base = {(*base)->first, (*base)->second};
    }
    return {};
}

Result<std::optional<std::pair<Revision, Hash>>> RocksCommitStore::readRevision(
    const std::string& key) const {
    std::string value;
    const auto status = db_->Get(rocksdb::ReadOptions(), family(Family::Meta), key, &value);
    if (status.IsNotFound()) return std::optional<std::pair<Revision, Hash>>();
    if (!status.ok()) return tl::unexpected(error(status, "read"));
    const auto read = decodedRevision(asBytes(value));
    if (!read) return damaged("the record '" + key + "' cannot be read");
    return read;
}

Result<void> RocksCommitStore::readEdited() {
    const std::unique_ptr<rocksdb::Iterator> at(
        db_->NewIterator(rocksdb::ReadOptions(), family(Family::Meta)));
    for (auto& [name, layer] : layers_) {
        const std::string all = key(kEditedPrefix, layer.number);
        at->SeekForPrev(key(kEditedPrefix, layer.number, ~Revision(0)));
        if (!at->Valid() || !text(at->key()).starts_with(all)) continue;
        const auto last = decoded<Revision>(bytes(at->value()));
        const std::string_view first = text(at->key()).substr(all.size());
        if (!last || first.size() != sizeof(Revision))
            return damaged("a record of a layer's commits cannot be read");
        layer.changed = *last;
        layer.runBegin = storekeys::bigEndian64(first);
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    return {};
}

void RocksCommitStore::findOlderSnapshots() {
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.snapshots(), ignored)) {
        const std::string name = entry.path().filename().string();
        std::uint32_t layer = 0;
        Revision revision = 0;
        const char* const end = name.data() + name.size();
        const auto number = std::from_chars(name.data(), end, layer);
        if (number.ec != std::errc() || number.ptr == end || *number.ptr != '-') continue;
        const auto rest = std::from_chars(number.ptr + 1, end, revision);
        if (rest.ec == std::errc() && rest.ptr == end) older_[layer].insert(revision);
    }
}

Result<SavedState> RocksCommitStore::readSaved(std::uint32_t layer) const {
    std::string value;
    const auto status =
        db_->Get(rocksdb::ReadOptions(), family(Family::Meta), key(kSavedPrefix, layer), &value);
    if (status.IsNotFound()) return SavedState();
    if (!status.ok()) return tl::unexpected(error(status, "read"));
    auto saved = decodedSaved(asBytes(value));
    if (!saved) return damaged("what it says of a saved layer cannot be read");
    return std::move(*saved);
}

Result<void> RocksCommitStore::verify() const {
    const auto clients = number<Revision>(Family::Clients, kClientsRevisionKey);
    if (!clients) return tl::unexpected(clients.error());
    if (clients->value_or(0) != head_.revision)
        return damagedAt(head_.revision, "is the newest, and what clients sent is of another");
    return verifyChain().and_then([this] { return verifyMark(); });
}

Result<void> RocksCommitStore::verifyMark() const {
    const auto mark = folder_.mark();
    if (!mark || mark->revision == 0) return {};
    if (mark->revision > head_.revision)
        return damagedAt(mark->revision, ("was acknowledged, and the history ends at " +
                                          std::to_string(head_.revision))
                                             .c_str());
    // After a crash of the machine the mark may be older than the last one written.
    if (mark->revision < base_.revision) return {};
    const auto hash = hashAt(mark->revision);
    if (!hash) return tl::unexpected(hash.error());
    if (*hash != mark->hash) return damagedAt(mark->revision, "is another than was acknowledged");
    return {};
}

// Verifies the newest commits first, because a crash damages the last writes.
Result<void> RocksCommitStore::verifyChain() const {
    const auto end = std::chrono::steady_clock::now() + options_.verifyTime;
    rocksdb::ReadOptions options;
    options.fill_cache = false;
    options.readahead_size = kMib;
    const std::unique_ptr<rocksdb::Iterator> at(db_->NewIterator(options, family(Family::Commits)));
    const auto follows = [](const StoredCommit& commit, const Hash& before) {
        return chainHash(before, withoutLength(*commit.frame)) == commit.hash;
    };
    Revision revision = head_.revision;
    std::optional<StoredCommit> later;  // needs the hash of the commit before it
    for (at->SeekToLast(); at->Valid() && revision > base_.revision; at->Prev(), --revision) {
        auto commit = commitAt(*at);
        if (!commit || commit->revision != revision)
            return damagedAt(revision, "is missing or out of its place");
        if (later ? !follows(*later, commit->hash) : commit->hash != head_.hash)
            return damagedAt(later ? later->revision : revision, "breaks the hash chain");
        if (std::chrono::steady_clock::now() > end) return {};
        later = std::move(commit);
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    if (revision != base_.revision) return damagedAt(revision, "is missing");
    if (later && !follows(*later, base_.hash))
        return damagedAt(base_.revision + 1, "breaks the hash chain");
    if (at->Valid() && base_.revision == 0) return damagedAt(1, "is not the first");
    return {};
}

/// Writes the log to tables, which are synced, before anything depends on it. The end of the log
/// may not be on the disk: its writer may have died before the sync, or the sync may have failed,
/// after which the system treats the data as written.
Result<void> RocksCommitStore::writeLogOut() {
    if (logBytes_ == 0) return {};
    const auto status = db_->Flush(rocksdb::FlushOptions(), handles_);
    if (!status.ok()) return tl::unexpected(error(status, "write to"));
    return {};
}

Result<void> RocksCommitStore::takeEpoch() {
    ++head_.epoch;
    rocksdb::WriteOptions options;
    options.sync = true;
    rocksdb::WriteBatch batch;
    batch.Put(family(Family::Meta), kEpochKey, slice(encoded<std::uint64_t>(head_.epoch)));
    batch.Put(family(Family::Meta), kIdentityKey, identity_.value);
    const auto status = db_->Write(options, &batch);
    if (!status.ok()) return tl::unexpected(error(status, "take over"));
    if (options_.durability == Durability::Synced)
        folder_.setMark({head_.revision, head_.hash});
    else
        folder_.setMark({});
    (void)measureSpace();
    return {};
}

}  // namespace usdlive::server
