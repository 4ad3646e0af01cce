#include "usdlive/server/storage/RocksCommitStore.h"

#include <rocksdb/db.h>
#include <rocksdb/sst_file_manager.h>
#include <rocksdb/write_batch.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <map>
#include <mutex>
#include <set>
#include <shared_mutex>
#include <unordered_map>

#include "FreeSpace.h"
#include "LayerSnapshots.h"
#include "RocksSupport.h"
#include "RocksTuning.h"
#include "StoreFolder.h"
#include "StoreKeys.h"
#include "StoreRules.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kHashBytes = sizeof(Hash::bytes);

constexpr std::chrono::milliseconds kSpaceCacheTime{100};
// With so much more than is needed nobody looks again within that time.
constexpr std::uint64_t kPlenty = 1024 * kMib;
constexpr std::size_t kKnownClients = 10'000;
// Free space that append() leaves: half of what is kept for everything, within these.
constexpr std::uint64_t kLeastMargin = 4 * kMib, kMostMargin = 64 * kMib;
// A batch is written to the log, to a table, and to another one when tables are merged.
constexpr std::uint64_t kCopies = 3;
constexpr std::size_t kRecordBytes = 256;  // of a commit, beside its frame, about
// Opening writes what is in the log to tables.
constexpr std::uint64_t kOpeningBytes = 2 * kMib;
constexpr std::uint64_t kLongLogBytes = 4 * kMib;

// Keys of the meta family. Lower-case names stand alone, a capital begins the key of each of many.
constexpr const char* kHeadKey = "head";    // revision, hash
constexpr const char* kEpochKey = "epoch";  // u64
constexpr char kLayerPrefix = 'L';          // name -> number
constexpr char kEditedPrefix = 'T';         // number, revision -> the last of a run of commits
constexpr char kFormerChangedPrefix = 'C';  // of format 1
constexpr char kSavedPrefix = 'S';          // number -> revision, file
constexpr char kCheckpointPrefix = 'K';     // name -> revision, time, user
constexpr char kNamespacePrefix = 'N';      // revision -> its moves and deletes
// In `clients`, behind them all: the revision that it is of.
const std::string kClientsRevisionKey(4, '\xff');
// A run of commits for a layer, and another one that begins so close behind it, are read as one.
constexpr Revision kSmallGap = 8;
// Commits of an older format that are looked through before what was found is written.
constexpr std::size_t kUpgradedAtOnce = 1'000;

std::string key(char prefix, std::string_view name) { return prefix + std::string(name); }
std::string key(char prefix, std::uint32_t number) {
    std::string key(1, prefix);
    storekeys::appendBigEndian(key, number);
    return key;
}
std::string key(char prefix, Revision revision) { return prefix + storekeys::commit(revision); }
std::string key(char prefix, std::uint32_t number, Revision revision) {
    return key(prefix, number) + storekeys::commit(revision);
}

template <Number T>
Bytes encoded(T number) {
    Bytes bytes(sizeof(T));
    std::memcpy(bytes.data(), &number, sizeof(T));
    return bytes;
}
template <Number T>
std::optional<T> decoded(ByteView bytes) {
    ByteReader in(bytes);
    const T number = in.number<T>();
    return in.finished() ? std::optional(number) : std::nullopt;
}

Hash hashOf(ByteView bytes) {
    Hash hash;
    std::ranges::copy(bytes.first(kHashBytes), hash.bytes.begin());
    return hash;
}

constexpr std::uint8_t kHasFile = 1, kHasComing = 2;

Bytes encodedSaved(const SavedState& saved) {
    Bytes bytes = encoded<Revision>(saved.revision);
    appendNumber<std::uint8_t>(bytes,
                               (saved.file ? kHasFile : 0) | (saved.coming ? kHasComing : 0));
    if (saved.file) {
        const auto& [trace, hash] = *saved.file;
        appendNumber<std::uint64_t>(bytes, trace.size);
        appendNumber<std::uint64_t>(bytes, trace.inode);
        appendNumber<std::int64_t>(bytes, trace.modifiedNs);
        appendNumber<std::int64_t>(bytes, trace.changedNs);
        appendBytes(bytes, hash.bytes);
    }
    if (saved.coming) {
        appendNumber<Revision>(bytes, saved.coming->revision);
        appendBytes(bytes, saved.coming->hash.bytes);
    }
    return bytes;
}
std::optional<SavedState> decodedSaved(ByteView bytes) {
    ByteReader in(bytes);
    SavedState saved;
    saved.revision = in.u64();
    const std::uint8_t has = in.left() > 0 ? in.u8() : 0;  // a store of before has no more
    const auto hash = [&] {
        const ByteView bytes = in.take(kHashBytes);
        return bytes.empty() ? Hash() : hashOf(bytes);
    };
    if (has & kHasFile) {
        FileStamp& file = saved.file.emplace();
        file.trace.size = in.u64();
        file.trace.inode = in.u64();
        file.trace.modifiedNs = in.i64();
        file.trace.changedNs = in.i64();
        file.hash = hash();
    }
    if (has & kHasComing) {
        const Revision revision = in.u64();
        saved.coming = SavedState::Coming{revision, hash()};
    }
    return in.finished() ? std::optional(saved) : std::nullopt;
}

Bytes encodedCheckpoint(const Checkpoint& checkpoint) {
    Bytes bytes = encoded<Revision>(checkpoint.revision);
    appendNumber<std::uint64_t>(bytes, checkpoint.timeMs);
    appendText(bytes, checkpoint.user.value);
    return bytes;
}
std::optional<Checkpoint> decodedCheckpoint(std::string_view name, ByteView bytes) {
    ByteReader in(bytes);
    Checkpoint checkpoint{std::string(name), in.u64(), {}, 0};
    checkpoint.timeMs = in.u64();
    checkpoint.user.value = in.text();
    return in.finished() ? std::optional(std::move(checkpoint)) : std::nullopt;
}

Bytes encoded(std::span<const NamespaceChange> changes) {
    Bytes bytes;
    for (const NamespaceChange& change : changes) {
        appendText(bytes, change.layer.value);
        appendText(bytes, change.from);
        appendNumber<std::uint8_t>(bytes, change.to ? 1 : 0);
        if (change.to) appendText(bytes, *change.to);
    }
    return bytes;
}
bool decodeInto(std::vector<NamespaceChange>& changes, Revision revision, ByteView bytes) {
    ByteReader in(bytes);
    while (in.left() > 0) {
        NamespaceChange change{revision, {std::string(in.text())}, std::string(in.text()), {}};
        if (in.u8() == 1) change.to = in.text();
        changes.push_back(std::move(change));
    }
    return in.finished();
}

std::uint64_t logBytes(const std::filesystem::path& database) {
    std::uint64_t bytes = 0;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(database, error))
        if (entry.path().extension() == ".log") bytes += entry.file_size(error);
    return bytes;
}

class RocksCommitStore final : public CommitStore {
public:
    RocksCommitStore(StoreFolder folder, const RocksCommitStoreOptions& options)
        : folder_(std::move(folder)),
          options_(options),
          files_(rocksdb::NewSstFileManager(rocksdb::Env::Default())),
          reserve_(folder_.reserve(), options.reserveBytes) {}
    ~RocksCommitStore() override;

    Result<void> open();

    [[nodiscard]] Head head() const override;
    Result<void> append(std::span<const CommitRecord> commits) override;
    Result<void> read(Revision from, Revision to,
                      const std::function<bool(const StoredCommit&)>& visit) const override;
    [[nodiscard]] Result<Hash> hashAt(Revision revision) const override;
    [[nodiscard]] Result<std::vector<LayerId>> layers() const override;
    [[nodiscard]] Result<std::optional<LayerDoc>> loadLayer(const LayerId& layer,
                                                            Replayed* replayed) const override;
    Result<std::size_t> keepSnapshot(const LayerId& layer, const LayerDoc& doc, Revision revision,
                                     const Hash& hash) override;
    [[nodiscard]] Result<SavedState> saved(const LayerId& layer) const override;
    Result<void> setSaved(const LayerId& layer, const SavedState& saved) override;
    [[nodiscard]] Result<std::vector<LayerId>> unsavedLayers() const override;
    [[nodiscard]] Result<std::vector<NamespaceChange>> namespaceChanges(
        Revision revision) const override;
    [[nodiscard]] Result<std::optional<Revision>> committed(
        const TransactionId& transaction) const override;
    [[nodiscard]] Result<std::uint64_t> lastSequence(const ClientId& client) const override;
    Result<void> addCheckpoint(const Checkpoint& checkpoint) override;
    [[nodiscard]] Result<std::vector<Checkpoint>> checkpoints() const override;
    [[nodiscard]] bool hasSpace() const override;

private:
    struct Layer {
        std::uint32_t number = 0;
        Revision changed = 0;   // by which commit last
        Revision runBegin = 0;  // of the run of commits for it that this one belongs to
        SavedState saved;
    };
    using Layers = std::map<LayerId, Layer>;
    /// What one append() writes, and what it makes of the values in memory.
    struct Group {
        explicit Group(std::size_t bytes) : batch(bytes) {}
        rocksdb::WriteBatch batch;
        Head head;
        std::map<std::pair<LayerId, Revision>, Revision> runs;  // of commits: begin -> last
        Layers layers;                                          // these, as they are after it
        std::set<LayerId> saved;                    // those that it brings in from their files
        std::map<ClientId, std::uint64_t> clients;  // the highest numbers of their transactions
    };

    // Opening.
    Result<void> checkRoom();
    Result<void> openDatabase();
    Result<void> readHead();
    Result<void> readLayers();
    Result<void> upgrade();
    Result<void> readEdited();
    [[nodiscard]] Result<SavedState> readSaved(std::uint32_t layer) const;
    Result<void> verify() const;
    Result<void> verifyMark() const;
    Result<void> verifyChain() const;
    Result<void> writeLogOut();
    Result<void> takeEpoch();

    // Appending.
    Result<void> addTo(Group& group, const CommitRecord& commit);
    void addEdited(Group& group, const LayerId& name, Revision revision);
    void addRecord(Group& group, const CommitRecord& commit);
    Layer& layerOf(Group& group, const LayerId& name);
    Result<void> addTransaction(Group& group, const TransactionId& id, Revision revision);
    void addFound(Group& group);
    void addHead(Group& group);
    void flushSoon();
    Result<void> write(rocksdb::WriteBatch& batch);
    Result<void> checkFailed() const;

    // Space.
    struct Space {
        std::uint64_t usable = 0, least = 0, margin = 0;
    };
    Space measureSpace() const;
    Result<void> checkSpace(std::uint64_t bytes) const;

    // Reading.
    [[nodiscard]] rocksdb::ColumnFamilyHandle* family(Family family) const {
        return handles_[std::size_t(family)];
    }
    [[nodiscard]] Error error(const rocksdb::Status& status, const char* verb) const {
        return rocksError(status, verb, folder_.path());
    }
    tl::unexpected<Error> damaged(const std::string& why) const {
        return fail(ErrorCode::StorageCorrupt,
                    "the store " + folder_.path().string() + " is damaged: " + why);
    }
    tl::unexpected<Error> damagedAt(Revision revision, const char* what) const {
        return damaged("commit " + std::to_string(revision) + " " + what);
    }
    /// Nothing: there is no such record.
    template <Number T>
    Result<std::optional<T>> number(Family from, const std::string& key) const;
    /// The runs of commits after `revision` that are for a layer, in order.
    struct Run {
        Revision first = 0, last = 0;
    };
    [[nodiscard]] Result<std::vector<Run>> runsAfter(std::uint32_t layer, Revision revision) const;
    /// Has `doc`, which is the layer at `revision`, follow the commits since. Their replayCost().
    Result<std::size_t> follow(LayerDoc& doc, const LayerId& layer, std::uint32_t number,
                               Revision revision) const;
    [[nodiscard]] std::uint32_t numberOf(const LayerId& layer) const;  // 0: there is none
    /// Nothing: none that can be read and goes with the log.
    [[nodiscard]] std::optional<LayerSnapshot> readSnapshot(std::uint32_t layer) const;
    /// Visits the records of the meta family whose key begins with `prefix`, from `start` on.
    Result<void> each(char prefix, const std::string& start,
                      const std::function<bool(std::string_view, ByteView)>& visit) const;
    /// Commits as they are stored; nothing when the value is too short to be one.
    [[nodiscard]] std::optional<StoredCommit> commitAt(const rocksdb::Iterator& iterator) const;

    StoreFolder folder_;
    const RocksCommitStoreOptions options_;
    const std::shared_ptr<rocksdb::SstFileManager> files_;
    std::uint64_t logBytes_ = 0;  // that opening had to do again
    std::unique_ptr<rocksdb::DB> db_;
    std::vector<rocksdb::ColumnFamilyHandle*> handles_;

    mutable std::shared_mutex mutex_;  // guards the next three
    Head head_;
    Layers layers_;
    std::optional<Error> failure_;

    // append()'s own: the highest numbers of who has sent something since the opening.
    std::unordered_map<ClientId, std::uint64_t> highest_;

    std::mutex snapshotMutex_;  // held while one is written; guards the next
    // Of layers, that were written since the opening: revision and bytes.
    std::map<std::uint32_t, std::pair<Revision, std::size_t>> snapshots_;

    mutable std::mutex spaceMutex_;  // guards the next four
    mutable Reserve reserve_;
    mutable Clock::time_point spaceTime_;
    mutable bool hasSpace_ = false;
    mutable std::uint64_t plenty_ = 0;  // beyond what edits leave free
};

// --- Opening ------------------------------------------------------------------------------------

RocksCommitStore::~RocksCommitStore() {
    for (auto* handle : handles_) db_->DestroyColumnFamilyHandle(handle);
    if (db_) db_->Close().PermitUncheckedError();
}

Result<void> RocksCommitStore::open() {
    return checkRoom()
        .and_then([this] { return openDatabase(); })
        .and_then([this] { return readHead(); })
        .and_then([this] { return readLayers(); })
        .and_then([this] { return verify(); })
        .and_then([this] { return upgrade(); })
        .and_then([this] { return readEdited(); })
        .and_then([this] { return writeLogOut(); })
        .and_then([this] { return takeEpoch(); });
}

// RocksDB (as Debian builds it) ends the process when the disk is full.
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
    // Where commits were acknowledged nothing is to be made anew.
    const auto mark = folder_.mark();
    options.create_if_missing = !mark || mark->revision == 0;
    auto families = columnFamilies();
    if (folder_.format() < StoreFolder::kFormat) families.push_back(formerFamily());
    rocksdb::DB* opened = nullptr;
    const auto status =
        rocksdb::DB::Open(options, folder_.database().string(), families, &handles_, &opened);
    db_.reset(opened);
    // RocksDB syncs what is in its folder, and not that there is one.
    if (status.ok()) return syncFolder(folder_.path());
    // Files that are missing, short or from elsewhere come as these two.
    const bool broken = status.IsInvalidArgument() || status.IsPathNotFound();
    Error what = error(status, "open");
    if (broken) what.code = ErrorCode::StorageCorrupt;
    return tl::unexpected(std::move(what));
}

Result<void> RocksCommitStore::readHead() {
    const auto epoch = number<std::uint64_t>(Family::Meta, kEpochKey);
    if (!epoch) return tl::unexpected(epoch.error());
    head_.epoch = epoch->value_or(0);
    std::string value;
    const auto status = db_->Get(rocksdb::ReadOptions(), family(Family::Meta), kHeadKey, &value);
    if (status.IsNotFound()) return {};
    if (!status.ok()) return tl::unexpected(error(status, "read"));
    if (value.size() != sizeof(Revision) + kHashBytes) return damaged("its head cannot be read");
    ByteReader in(asBytes(value));
    head_.revision = in.u64();
    head_.hash = hashOf(in.take(kHashBytes));
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
    }
    return {};
}

/// A store of format 1 held each layer field by field, and other keys for transactions. The log has
/// all that is wanted now.
Result<void> RocksCommitStore::upgrade() {
    if (folder_.format() == StoreFolder::kFormat) return {};
    Group group(0);
    group.head = head_;
    group.batch.DeleteRange(family(Family::Clients), std::string(), std::string(64, '\xff'));
    group.batch.DeleteRange(family(Family::Meta), std::string(1, kFormerChangedPrefix),
                            std::string(1, kFormerChangedPrefix + 1));
    Result<void> done;
    const auto writeOut = [&] {
        addFound(group);
        done = checkSpace(group.batch.GetDataSize()).and_then([&] { return write(group.batch); });
        for (const auto& [name, layer] : group.layers) layers_[name] = layer;
        group = Group(0);
        group.head = head_;
        return bool(done);
    };
    const auto visit = [&](const StoredCommit& stored) {
        const auto commit = decodeCommit(stored);
        if (!commit) {
            done = tl::unexpected(commit.error());
            return false;
        }
        for (const Edit& edit : commit->edits) addEdited(group, edit.layer, commit->revision);
        if (commit->imported) addEdited(group, *commit->imported, commit->revision);
        done = addTransaction(group, commit->id, commit->revision);
        if (!done || group.batch.Count() < kUpgradedAtOnce) return bool(done);
        return writeOut();
    };
    const auto read = this->read(1, head_.revision, visit);
    if (!read) return read;
    addHead(group);
    if (!done || !writeOut()) return done;
    // Whatever the durability: the next two are synced.
    if (const auto synced = db_->SyncWAL(); !synced.ok())
        return tl::unexpected(error(synced, "upgrade"));
    for (; handles_.size() > columnFamilies().size(); handles_.pop_back()) {
        if (const auto dropped = db_->DropColumnFamily(handles_.back()); !dropped.ok())
            return tl::unexpected(error(dropped, "upgrade"));
        db_->DestroyColumnFamilyHandle(handles_.back());
    }
    return folder_.setFormat();
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
    const bool former = folder_.format() < StoreFolder::kFormat;
    const auto clients =
        former ? head_.revision : number<Revision>(Family::Clients, kClientsRevisionKey);
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
    const auto hash = hashAt(mark->revision);
    if (!hash) return tl::unexpected(hash.error());
    if (*hash != mark->hash) return damagedAt(mark->revision, "is another than was acknowledged");
    return {};
}

// Newest first, as what was written last is what a crash damages.
Result<void> RocksCommitStore::verifyChain() const {
    const auto end = Clock::now() + options_.verifyTime;
    rocksdb::ReadOptions options;
    options.fill_cache = false;
    options.readahead_size = kMib;
    const std::unique_ptr<rocksdb::Iterator> at(db_->NewIterator(options, family(Family::Commits)));
    const auto follows = [](const StoredCommit& commit, const Hash& before) {
        return chainHash(before, withoutLength(*commit.frame)) == commit.hash;
    };
    Revision revision = head_.revision;
    std::optional<StoredCommit> later;  // not verified yet: it needs the hash before it
    for (at->SeekToLast(); at->Valid(); at->Prev(), --revision) {
        auto commit = commitAt(*at);
        if (revision == 0 || !commit || commit->revision != revision)
            return damagedAt(revision + (revision == 0), "is missing or out of its place");
        if (later ? !follows(*later, commit->hash) : commit->hash != head_.hash)
            return damagedAt(later ? later->revision : revision, "breaks the hash chain");
        if (Clock::now() > end) return {};
        later = std::move(commit);
    }
    if (!at->status().ok()) return tl::unexpected(error(at->status(), "read"));
    if (revision != 0) return damagedAt(revision, "is missing");
    if (later && !follows(*later, Hash())) return damagedAt(1, "breaks the hash chain");
    return {};
}

/// What the log says may not be on the disk: whoever wrote it died before the sync, or the sync
/// failed, after which the system takes it for written. So it goes to tables, which are synced,
/// before anything builds on it.
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
    const auto status = db_->Put(options, family(Family::Meta), kEpochKey,
                                 slice(encoded<std::uint64_t>(head_.epoch)));
    if (!status.ok()) return tl::unexpected(error(status, "take over"));
    if (options_.durability == Durability::Synced)
        folder_.setMark({head_.revision, head_.hash});
    else
        folder_.setMark({});
    (void)measureSpace();
    return {};
}

// --- Appending ----------------------------------------------------------------------------------

CommitStore::Head RocksCommitStore::head() const {
    const std::shared_lock lock(mutex_);
    return head_;
}

Result<void> RocksCommitStore::append(std::span<const CommitRecord> commits) {
    if (commits.empty()) return {};
    if (const auto ready = checkFailed().and_then([&] { return mayAppend(commits, head_); });
        !ready)
        return ready;
    std::size_t bytes = 0;
    for (const CommitRecord& commit : commits) bytes += commit.frame->size() + kRecordBytes;

    Group group(bytes);
    group.head = head_;
    for (const CommitRecord& commit : commits)
        if (const auto added = addTo(group, commit); !added) return added;
    addFound(group);
    addHead(group);
    const auto written =
        checkSpace(group.batch.GetDataSize()).and_then([&] { return write(group.batch); });
    if (!written) return written;

    if (options_.durability == Durability::Synced)
        folder_.setMark({group.head.revision, group.head.hash});
    if (highest_.size() > kKnownClients) highest_.clear();
    for (const auto& [client, highest] : group.clients) highest_[client] = highest;
    const std::unique_lock lock(mutex_);
    head_ = group.head;
    for (auto& [name, layer] : group.layers) {
        // Somebody may have saved it meanwhile.
        Layer& known = layers_[name];
        const bool isNew = group.saved.contains(name);
        if (!isNew || known.saved.revision > layer.saved.revision) layer.saved = known.saved;
        known = layer;
    }
    if (group.batch.GetDataSize() > kLongLogBytes) flushSoon();
    return {};
}

/// Has RocksDB write what is in its log to tables, beside everything else: the next opening would
/// have to do what the log says once more.
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

/// A run goes on while the next commit for the layer is near; its record is written anew.
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
    const rocksdb::Slice values[] = {slice(commit.hash.bytes), slice(*commit.frame)};
    group.batch.Put(family(Family::Commits), {keys, 1}, {values, 2});
}

// Layers are added by this thread alone, which need not lock to look for one.
RocksCommitStore::Layer& RocksCommitStore::layerOf(Group& group, const LayerId& name) {
    const auto [entry, added] = group.layers.try_emplace(name);
    if (!added) return entry->second;
    if (const auto known = layers_.find(name); known != layers_.end()) {
        const std::shared_lock lock(mutex_);  // of setSaved()
        return entry->second = known->second;
    }
    // No layer is ever taken out, so their count is the highest number.
    std::uint32_t number = std::uint32_t(layers_.size());
    for (const auto& [other, layer] : group.layers) number = std::max(number, layer.number);
    entry->second.number = number + 1;
    group.batch.Put(family(Family::Meta), key(kLayerPrefix, name.value),
                    slice(encoded<std::uint32_t>(number + 1)));
    return entry->second;
}

Result<void> RocksCommitStore::addTransaction(Group& group, const TransactionId& id,
                                              Revision revision) {
    if (id.sequence == 0) return {};  // an import or a reload, which nobody sends again
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

/// What the group's commits say of layers and clients.
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
        const std::shared_lock lock(mutex_);  // of setSaved()
        const auto known = layers_.find(name);
        if (known == layers_.end() || layer.saved.revision >= known->second.saved.revision)
            group.batch.Put(family(Family::Meta), key(kSavedPrefix, layer.number),
                            slice(encodedSaved(layer.saved)));
    }
}

void RocksCommitStore::addHead(Group& group) {
    Bytes head = encoded<Revision>(group.head.revision);
    appendBytes(head, group.head.hash.bytes);
    group.batch.Put(family(Family::Meta), kHeadKey, slice(head));
    group.batch.Put(family(Family::Clients), kClientsRevisionKey,
                    slice(encoded<Revision>(group.head.revision)));
}

Result<void> RocksCommitStore::write(rocksdb::WriteBatch& batch) {
    rocksdb::WriteOptions options;
    options.sync = options_.durability == Durability::Synced;
    const auto status = db_->Write(options, &batch);
    if (status.ok()) return {};
    // Part of it may be on the disk. Only opening anew tells what is, so there is no second try.
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

// --- Space --------------------------------------------------------------------------------------

RocksCommitStore::Space RocksCommitStore::measureSpace() const {
    std::uint64_t unflushed = 0;
    for (auto* handle : handles_) {
        std::uint64_t bytes = 0;
        db_->GetIntProperty(handle, rocksdb::DB::Properties::kCurSizeAllMemTables, &bytes);
        unflushed += bytes;
    }
    const std::lock_guard lock(spaceMutex_);
    const DiskSpace disk = diskSpace(folder_.path());
    Space space;
    const std::uint64_t wanted = minFree(options_.minFreeBytes, disk);
    space.margin = std::clamp(wanted / 2, kLeastMargin, kMostMargin);
    space.least = std::max(wanted, space.margin);
    const std::uint64_t usable = reserve_.usable(disk.free);
    space.usable = usable > unflushed ? usable - unflushed : 0;
    reserve_.adapt(disk.free, space.margin / 2, space.least);
    // Tables are merged only where that leaves some space.
    files_->SetMaxAllowedSpaceUsage(files_->GetTotalSize() + std::max(usable, kMib));
    hasSpace_ = space.usable >= space.least;
    plenty_ = hasSpace_ ? space.usable - space.least : 0;
    spaceTime_ = Clock::now();
    return space;
}

Result<void> RocksCommitStore::checkSpace(std::uint64_t bytes) const {
    {
        const std::lock_guard lock(spaceMutex_);
        if (Clock::now() < spaceTime_ + kSpaceCacheTime && plenty_ >= kPlenty + kCopies * bytes)
            return {};
    }
    const Space space = measureSpace();
    if (space.usable >= kCopies * bytes + space.margin) return {};
    return fail(ErrorCode::StorageFull, "the disk of the store " + folder_.path().string() +
                                            " has " + std::to_string(space.usable / kMib) +
                                            " MiB left, too little to go on");
}

bool RocksCommitStore::hasSpace() const {
    {
        const std::lock_guard lock(spaceMutex_);
        if (Clock::now() < spaceTime_ + kSpaceCacheTime) return hasSpace_;
    }
    const Space space = measureSpace();
    return space.usable >= space.least;
}

// --- Reading ------------------------------------------------------------------------------------

template <Number T>
Result<std::optional<T>> RocksCommitStore::number(Family from, const std::string& key) const {
    std::string value;
    const auto status = db_->Get(rocksdb::ReadOptions(), family(from), key, &value);
    if (status.IsNotFound()) return std::optional<T>();
    if (!status.ok()) return tl::unexpected(error(status, "read"));
    const auto number = decoded<T>(asBytes(value));
    if (!number) return damaged("a record cannot be read");
    return number;
}

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
    const ByteView frame = value.subspan(kHashBytes);
    return StoredCommit{storekeys::bigEndian64(text(at.key())),
                        std::make_shared<const Bytes>(frame.begin(), frame.end()), hashOf(value)};
}

Result<void> RocksCommitStore::read(Revision from, Revision to,
                                    const std::function<bool(const StoredCommit&)>& visit) const {
    Revision next = std::max<Revision>(from, 1);
    const Revision last = std::min(to, head().revision);
    if (next > last) return {};
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
    return damagedAt(next, "is missing or out of its place");
}

Result<Hash> RocksCommitStore::hashAt(Revision revision) const {
    if (revision == 0) return Hash{};
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
    if (!status.ok() || value.size() < kHashBytes) return damagedAt(revision, "is missing");
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
    at->SeekForPrev(key(kEditedPrefix, layer, revision));  // it may go on after `revision`
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
                                             std::uint32_t number, Revision revision) const {
    const auto runs = runsAfter(number, revision);
    if (!runs) return tl::unexpected(runs.error());
    std::size_t cost = 0;
    Result<void> followed;
    for (const auto& [first, last] : *runs) {
        const auto done = read(first, last, [&](const StoredCommit& stored) {
            followed = decodeCommit(stored).and_then([&](const Commit& commit) {
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

std::optional<LayerSnapshot> RocksCommitStore::readSnapshot(std::uint32_t layer) const {
    const auto content = sealedfile::read(folder_.snapshot(layer));
    auto snapshot = content ? decodeSnapshot(*content) : std::nullopt;
    if (!snapshot) return std::nullopt;
    const auto hash = hashAt(snapshot->revision);
    return hash && *hash == snapshot->hash ? std::move(snapshot) : std::nullopt;
}

/// A snapshot that is missing costs the time to do the whole log again.
Result<std::optional<LayerDoc>> RocksCommitStore::loadLayer(const LayerId& layer,
                                                            Replayed* replayed) const {
    const std::uint32_t number = numberOf(layer);
    if (number == 0) return std::optional<LayerDoc>();
    auto kept = readSnapshot(number);
    LayerSnapshot from = kept ? std::move(*kept) : LayerSnapshot();
    const auto cost = follow(from.doc, layer, number, from.revision);
    if (!cost) return tl::unexpected(cost.error());
    if (replayed) {
        std::error_code none;
        const auto bytes = std::filesystem::file_size(folder_.snapshot(number), none);
        *replayed = {from.revision == 0 || none ? 0 : bytes, *cost};
    }
    return std::optional(std::move(from.doc));
}

Result<std::size_t> RocksCommitStore::keepSnapshot(const LayerId& layer, const LayerDoc& doc,
                                                   Revision revision, const Hash& hash) {
    const std::uint32_t number = numberOf(layer);
    if (number == 0)
        return fail(ErrorCode::LayerNotFound, "the store holds no layer " + layer.value);
    const auto known = hashAt(revision);
    if (!known) return tl::unexpected(known.error());
    if (revision == 0 || *known != hash)
        return fail(ErrorCode::HistoryDiverged,
                    "the snapshot of " + layer.value + " is of another history");
    const std::lock_guard lock(snapshotMutex_);
    auto& [newest, size] = snapshots_[number];
    if (revision <= newest) return size;
    // Edits need the space more than it does, which stands beside the one before for a while.
    const auto fits = [this](std::size_t bytes) {
        const Space space = measureSpace();
        return space.usable >= 2 * space.least + kCopies * bytes;
    };
    const auto full = [&] {
        return fail(ErrorCode::StorageFull, "too little space for a snapshot of " + layer.value);
    };
    if (!fits(size)) return full();
    const Bytes content = encodeSnapshot({revision, hash, doc});
    if (!fits(content.size())) return full();
    if (auto done = sealedfile::replace(folder_.snapshot(number), content); !done)
        return tl::unexpected(done.error());
    newest = revision;
    return size = content.size();
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

Result<std::optional<Revision>> RocksCommitStore::committed(
    const TransactionId& transaction) const {
    const auto last = lastSequence(transaction.client);
    if (!last) return tl::unexpected(last.error());
    const std::uint64_t sequence = transaction.sequence;
    if (sequence == 0 || sequence > *last) return std::optional<Revision>();
    const std::string key = *last - sequence < kRemembered
                                ? storekeys::transaction(transaction.client, sequence)
                                : storekeys::lateTransaction(transaction.client, sequence);
    std::string value;
    const auto status = db_->Get(rocksdb::ReadOptions(), family(Family::Clients), key, &value);
    if (status.IsNotFound()) return std::optional<Revision>();
    if (!status.ok()) return tl::unexpected(error(status, "read"));
    ByteReader in(asBytes(value));
    const std::uint64_t held = in.u64();
    const Revision revision = in.u64();
    if (!in.finished()) return damaged("a record of a transaction cannot be read");
    return held == sequence ? std::optional(revision) : std::nullopt;
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

}  // namespace

Result<std::unique_ptr<CommitStore>> createRocksCommitStore(
    const std::filesystem::path& folder, const RocksCommitStoreOptions& options) {
    auto opened = StoreFolder::open(folder);
    if (!opened) return tl::unexpected(opened.error());
    auto store = std::make_unique<RocksCommitStore>(std::move(*opened), options);
    if (const auto done = store->open(); !done) return tl::unexpected(done.error());
    return store;
}

}  // namespace usdlive::server
