// The implementation of a CommitStore in RocksDB.
#pragma once

#include <rocksdb/db.h>
#include <rocksdb/sst_file_manager.h>
#include <rocksdb/write_batch.h>

#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <set>
#include <shared_mutex>
#include <unordered_map>

#include "storage/BackgroundWork.h"
#include "storage/FreeSpace.h"
#include "storage/LayerSnapshots.h"
#include "storage/RocksCommitStore.h"
#include "storage/RocksSupport.h"
#include "storage/RocksTuning.h"
#include "storage/StoreFolder.h"
#include "storage/StoreRecords.h"

namespace usdlive::server {

/// A CommitStore in RocksDB. Its parts: RocksCommitStore.cpp (disk space), RocksOpening.cpp,
/// RocksAppending.cpp (commits and snapshots), RocksReading.cpp (the log, layers and checkpoints),
/// RocksClients.cpp (transactions of clients), RocksCompacting.cpp (the base), RocksCopying.cpp.
class RocksCommitStore final : public CommitStore {
public:
    RocksCommitStore(StoreFolder folder, const RocksCommitStoreOptions& options)
        : folder_(std::move(folder)),
          options_(options),
          files_(rocksdb::NewSstFileManager(rocksdb::Env::Default())),
          reserve_(folder_.reserve(), options.reserveBytes) {}
    ~RocksCommitStore() override;

    Result<void> open();

    [[nodiscard]] StoreId identity() const override { return identity_; }
    [[nodiscard]] Head head() const override;
    [[nodiscard]] Base base() const override;
    Result<void> compact(Revision revision, const KeepRunning& keepRunning) override;
    [[nodiscard]] Result<void> copyTo(const std::filesystem::path& folder) const override;
    Result<void> append(std::span<const CommitRecord> commits) override;
    Result<void> read(Revision from, Revision to,
                      const std::function<bool(const StoredCommit&)>& visit) const override;
    [[nodiscard]] Result<Hash> hashAt(Revision revision) const override;
    [[nodiscard]] Result<std::vector<LayerId>> layers() const override;
    [[nodiscard]] Result<std::optional<LayerDoc>> layerAt(const LayerId& layer, Revision revision,
                                                          Replayed* replayed) const override;
    [[nodiscard]] Result<std::optional<LayerVersion>> versionAt(const LayerId& layer,
                                                                Revision revision) const override;
    Result<std::size_t> keepSnapshot(const LayerId& layer, const LayerDoc& doc, Revision revision,
                                     const Hash& hash) override;
    [[nodiscard]] Result<SavedState> saved(const LayerId& layer) const override;
    Result<void> setSaved(const LayerId& layer, const SavedState& saved) override;
    [[nodiscard]] Result<std::vector<LayerId>> unsavedLayers() const override;
    [[nodiscard]] Result<std::vector<NamespaceChange>> namespaceChanges(
        Revision revision) const override;
    [[nodiscard]] Result<ClientRecord> clientRecord(const ClientId& client) const override;
    Result<std::size_t> forgetClients(std::size_t most, const std::set<ClientId>& kept) override;
    [[nodiscard]] Revision forgottenUpTo() const override { return forgotten_; }
    Result<void> addCheckpoint(const Checkpoint& checkpoint) override;
    [[nodiscard]] Result<std::vector<Checkpoint>> checkpoints() const override;
    [[nodiscard]] Result<StoreSpace> space() const override;
    [[nodiscard]] bool hasSpace() const override;

private:
    /// The file with a layer's content at the base. `revision` is the base when the file was
    /// written; no commit since was for the layer. 0: there is no file.
    struct LayerBase {
        Revision revision = 0;
        Hash content;
    };
    struct Layer {
        std::uint32_t number = 0;
        Revision changed = 0;   // revision of the last commit for it
        Revision runBegin = 0;  // first revision of the last run of commits for it
        SavedState saved;
        LayerBase base;
    };
    using Layers = std::map<LayerId, Layer>;
    /// The records that one append() writes, and the resulting values in memory.
    struct Group {
        explicit Group(std::size_t bytes) : batch(bytes) {}
        rocksdb::WriteBatch batch;
        Head head;
        std::map<std::pair<LayerId, Revision>, Revision> runs;  // runs of commits: begin -> last
        Layers layers;                              // the changed layers, as they are afterwards
        std::set<LayerId> saved;                    // layers whose saved state it sets
        std::map<ClientId, std::uint64_t> clients;  // the highest transaction numbers
    };

    // Opening.
    Result<void> checkRoom();
    Result<void> openDatabase();
    Result<void> readHead();
    Result<void> readBase();
    /// Returns nothing if there is no such record.
    [[nodiscard]] Result<std::optional<std::pair<Revision, Hash>>> readRevision(
        const std::string& key) const;
    Result<void> readLayers();
    Result<void> readEdited();
    void findOlderSnapshots();
    [[nodiscard]] Result<SavedState> readSaved(std::uint32_t layer) const;
    Result<void> verify() const;
    Result<void> verifyMark() const;
    Result<void> verifyChain() const;
    Result<void> writeLogOut();
    Result<void> readIdentity();
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
    void keepOlder(std::uint32_t layer, Revision next);
    Result<void> write(rocksdb::WriteBatch& batch) {
        return write(batch, options_.durability == Durability::Synced);
    }
    Result<void> write(rocksdb::WriteBatch& batch, bool synced);
    Result<void> checkFailed() const;
    Result<void> checkThere() const;

    // Compacting.
    Result<void> verifyReplaced(Revision to, const KeepRunning& keepRunning) const;
    /// Writes the file with the layer's content at `to`. Returns nothing if the existing file is
    /// still right, or if the layer was added later.
    Result<std::optional<LayerBase>> makeBase(const LayerId& layer, const Layer& known,
                                              const Base& to, const KeepRunning& keepRunning);
    Result<void> removeReplaced();
    Result<void> removeReplacedRecords();
    Result<void> removeCommitsBefore(const std::string& end);
    void removeStrayBases();
    void removeOldSnapshots();
    void removeSnapshot(std::uint32_t layer, Revision revision);
    [[nodiscard]] bool isRemoved() const;

    // Clients.
    [[nodiscard]] Result<std::vector<ClientId>> clients() const;
    template <class Visit>
    [[nodiscard]] Result<void> forEachTransaction(const ClientId& client, Visit visit) const;
    /// Returns the highest number of a client's committed transactions; 0: none.
    [[nodiscard]] Result<std::uint64_t> lastSequence(const ClientId& client) const;
    [[nodiscard]] Result<Revision> newestOf(const ClientId& client,
                                            std::vector<std::string>* keys) const;
    Result<std::pair<std::size_t, std::size_t>> forgetSome(
        std::span<const std::pair<Revision, ClientId>> byAge);

    // Space.
    /// A batch is written to the log, then to a table, and again when tables are merged.
    static constexpr std::uint64_t kCopies = 3;
    struct Space {
        std::uint64_t usable = 0, least = 0, margin = 0;
    };
    Space measureSpace() const;
    void resume() const;
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
    /// Returns the error for a missing commit: HistoryReplaced if it was removed meanwhile.
    tl::unexpected<Error> missing(Revision revision) const;
    /// Returns nothing if there is no such record.
    template <Number T>
    Result<std::optional<T>> number(Family from, const std::string& key) const;
    /// A run of commits for a layer. runsAfter() returns those after `revision`, in order.
    struct Run {
        Revision first = 0, last = 0;
    };
    [[nodiscard]] Result<std::vector<Run>> runsAfter(std::uint32_t layer, Revision revision) const;
    /// Applies the layer's commits of the runs to `doc`. Returns their replayCost().
    Result<std::size_t> follow(LayerDoc& doc, const LayerId& layer, const std::vector<Run>& runs,
                               const KeepRunning& keepRunning) const;
    /// The last revision that versionAt() may name, 0: the base.
    [[nodiscard]] Result<Revision> lastChange(std::uint32_t layer, Revision revision,
                                              bool hasBase) const;
    [[nodiscard]] std::uint32_t numberOf(const LayerId& layer) const;  // 0: there is none
    /// Returns the layer's content at the base, with the base's revision. Nothing if it was added
    /// later.
    [[nodiscard]] Result<std::optional<LayerSnapshot>> readBaseOf(const LayerId& layer,
                                                                  const Base& base) const;
    [[nodiscard]] Result<std::optional<LayerDoc>> layerFrom(const Base& base, const LayerId& layer,
                                                            Revision revision,
                                                            Replayed* replayed) const;
    /// Returns the newest readable snapshot of this history that is not after `upTo`.
    [[nodiscard]] std::optional<LayerSnapshot> readSnapshot(std::uint32_t layer,
                                                            Revision upTo) const;
    [[nodiscard]] std::optional<LayerSnapshot> readSnapshot(
        const std::filesystem::path& path) const;
    /// Returns the revisions of the layer's older snapshots.
    [[nodiscard]] std::vector<Revision> olderSnapshots(std::uint32_t layer) const;
    /// Visits the records of the meta family with this prefix, from `start` on.
    Result<void> each(char prefix, const std::string& start,
                      const std::function<bool(std::string_view, ByteView)>& visit) const;
    /// Returns a stored commit, or nothing if the value is too short.
    [[nodiscard]] std::optional<StoredCommit> commitAt(const rocksdb::Iterator& iterator) const;

    StoreFolder folder_;
    const RocksCommitStoreOptions options_;
    const std::shared_ptr<rocksdb::SstFileManager> files_;
    const std::shared_ptr<BackgroundWork> background_ = std::make_shared<BackgroundWork>();
    std::uint64_t logBytes_ = 0;  // size of the log that was replayed at opening
    StoreId identity_;            // set by open()
    std::unique_ptr<rocksdb::DB> db_;
    std::vector<rocksdb::ColumnFamilyHandle*> handles_;

    mutable std::shared_mutex mutex_;  // guards the next four
    Head head_;
    Base base_;
    Layers layers_;
    mutable std::optional<Error> failure_;

    // Held while commits are appended or clients are forgotten. Guards the next member.
    std::mutex clientsMutex_;
    // The highest numbers of the clients that have sent a transaction since the opening.
    std::unordered_map<ClientId, std::uint64_t> highest_;
    std::atomic<Revision> forgotten_ = 0;  // see forgottenUpTo()

    mutable std::mutex compactMutex_;  // held while the base changes or is copied
    std::mutex snapshotMutex_;         // held while a snapshot is written; guards the next
    // Snapshots written since the opening: revision and size by layer.
    std::map<std::uint32_t, std::pair<Revision, std::size_t>> snapshots_;

    mutable std::mutex olderMutex_;                      // guards the next
    std::map<std::uint32_t, std::set<Revision>> older_;  // older snapshots of a layer

    mutable std::mutex spaceMutex_;  // guards the next four
    mutable Reserve reserve_;
    mutable std::chrono::steady_clock::time_point spaceTime_;
    mutable bool hasSpace_ = false;
    mutable std::uint64_t plenty_ = 0;  // bytes above the space that edits keep free
};

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

}  // namespace usdlive::server
