// A commit store in memory, for tests and the simulation.
#include "storage/MemoryCommitStore.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "project/CommitContent.h"
#include "storage/StoreRules.h"

namespace usdlive::server {

namespace {

struct StoredLayer {
    LayerDoc base;  // the content at the base
    std::optional<LayerDoc> snapshot;
    Revision snapshotRevision = 0;
    std::size_t snapshotBytes = 0;
    Revision first = 0, changed = 0;
    SavedState saved;
};

}  // namespace

class MemoryDisk {
public:
    explicit MemoryDisk(StoreId store) : identity(std::move(store)) {}

    const StoreId identity;
    std::mutex mutex;  // guards all members below
    CommitStore::Head head;
    CommitStore::Base base;
    std::vector<StoredCommit> commits;  // after the base
    std::vector<NamespaceChange> namespaceChanges;
    std::map<LayerId, StoredLayer> layers;
    std::map<ClientId, std::map<std::uint64_t, Revision>> clients;
    std::map<TransactionId, Revision> late;  // older than the remembered ones of their clients
    Revision forgotten = 0;                  // see forgottenUpTo()
    std::map<std::string, Checkpoint> checkpoints;
};

namespace {

class MemoryCommitStore final : public CommitStore {
public:
    explicit MemoryCommitStore(std::shared_ptr<MemoryDisk> disk) : disk_(std::move(disk)) {
        const std::lock_guard lock(disk_->mutex);
        ++disk_->head.epoch;
    }

    [[nodiscard]] StoreId identity() const override { return disk_->identity; }
    [[nodiscard]] Head head() const override {
        const std::lock_guard lock(disk_->mutex);
        return disk_->head;
    }
    [[nodiscard]] Base base() const override {
        const std::lock_guard lock(disk_->mutex);
        return disk_->base;
    }
    Result<void> compact(Revision revision, const KeepRunning& keepRunning) override {
        const std::lock_guard lock(disk_->mutex);
        const Revision base = disk_->base.revision;
        if (revision <= base) return {};
        if (revision > disk_->head.revision)
            return fail(ErrorCode::FutureRevision,
                        "there is no commit " + std::to_string(revision) + " yet");
        std::map<LayerId, LayerDoc> held;
        for (const auto& [name, layer] : disk_->layers) {
            if (!keepRunning()) return fail(ErrorCode::ShuttingDown, "the operation was cancelled");
            LayerDoc& doc = held[name] = layer.base;
            if (const auto done = follow(doc, name, base, revision); !done)
                return tl::unexpected(done.error());
        }
        for (auto& [name, doc] : held) disk_->layers[name].base = std::move(doc);
        const auto end = disk_->commits.begin() + std::ptrdiff_t(revision - base);
        disk_->base = {revision, (end - 1)->hash};
        disk_->commits.erase(disk_->commits.begin(), end);
        std::erase_if(disk_->namespaceChanges, [&](const NamespaceChange& change) {
            return change.revision <= revision &&
                   change.revision + kNamespaceLogRevisions <= disk_->head.revision;
        });
        return {};
    }
    Result<void> append(std::span<const CommitRecord> commits) override {
        const std::lock_guard lock(disk_->mutex);
        if (const auto fits = mayAppend(commits, disk_->head); !fits) return fits;
        for (const CommitRecord& commit : commits) add(commit);
        return {};
    }
    Result<void> read(Revision from, Revision to,
                      const std::function<bool(const StoredCommit&)>& visit) const override {
        const Revision first = base().revision, last = std::min(to, head().revision);
        for (Revision next = from == 0 ? first + 1 : from; next <= last; ++next) {
            const auto commit = commitAt(next);
            if (!commit) return tl::unexpected(commit.error());
            if (!visit(*commit)) break;
        }
        return {};
    }
    [[nodiscard]] Result<Hash> hashAt(Revision revision) const override {
        if (const Base first = base(); revision == first.revision) return first.hash;
        if (revision > head().revision)
            return fail(ErrorCode::FutureRevision,
                        "there is no commit " + std::to_string(revision) + " yet");
        return commitAt(revision).map([](const StoredCommit& commit) { return commit.hash; });
    }
    [[nodiscard]] Result<std::vector<LayerId>> layers() const override {
        return layersThat([](const StoredLayer&) { return true; });
    }
    [[nodiscard]] Result<std::vector<LayerId>> unsavedLayers() const override {
        return layersThat(
            [](const StoredLayer& layer) { return layer.changed > layer.saved.revision; });
    }
    [[nodiscard]] Result<std::optional<LayerDoc>> layerAt(const LayerId& layer, Revision revision,
                                                          Replayed* replayed) const override {
        const std::lock_guard lock(disk_->mutex);
        const Revision base = disk_->base.revision;
        if (revision < base) return historyReplaced(revision, base);
        const auto known = disk_->layers.find(layer);
        if (known == disk_->layers.end()) return std::optional<LayerDoc>();
        const StoredLayer& stored = known->second;
        auto [doc, from] = beginning(stored, revision);
        const Revision to =
            std::min<Revision>(std::max(revision, stored.first), disk_->head.revision);
        const auto cost = follow(doc, layer, from, to);
        if (!cost) return tl::unexpected(cost.error());
        if (replayed) *replayed = {stored.snapshotBytes, *cost};
        return std::optional(std::move(doc));
    }
    [[nodiscard]] Result<std::optional<LayerVersion>> versionAt(const LayerId& layer,
                                                                Revision revision) const override {
        const std::lock_guard lock(disk_->mutex);
        const Base base = disk_->base;
        if (revision < base.revision) return historyReplaced(revision, base.revision);
        const auto known = disk_->layers.find(layer);
        if (known == disk_->layers.end()) return std::optional<LayerVersion>();
        const StoredLayer& stored = known->second;
        const Revision at = std::min(std::max(revision, stored.first), stored.changed);
        if (at <= base.revision) return LayerVersion{base.revision, base.hash};
        return LayerVersion{at, disk_->commits[at - base.revision - 1].hash};
    }
    Result<std::size_t> keepSnapshot(const LayerId& layer, const LayerDoc& doc, Revision revision,
                                     const Hash& hash) override {
        const std::lock_guard lock(disk_->mutex);
        const auto known = disk_->layers.find(layer);
        if (known == disk_->layers.end())
            return fail(ErrorCode::LayerNotFound, "the store has no layer " + layer.value);
        const Base base = disk_->base;
        if (revision < base.revision) return historyReplaced(revision, base.revision);
        if (revision == 0 || revision > disk_->head.revision ||
            hash != (revision == base.revision ? base.hash
                                               : disk_->commits[revision - base.revision - 1].hash))
            return fail(ErrorCode::HistoryDiverged, "the snapshot belongs to another history");
        if (revision <= known->second.snapshotRevision) return known->second.snapshotBytes;
        known->second.snapshot = doc;
        known->second.snapshotRevision = revision;
        return known->second.snapshotBytes = doc.dump().size();
    }
    [[nodiscard]] Result<SavedState> saved(const LayerId& layer) const override {
        const std::lock_guard lock(disk_->mutex);
        const auto known = disk_->layers.find(layer);
        return known == disk_->layers.end() ? SavedState() : known->second.saved;
    }
    Result<void> setSaved(const LayerId& layer, const SavedState& saved) override {
        const std::lock_guard lock(disk_->mutex);
        const auto known = disk_->layers.find(layer);
        if (known == disk_->layers.end())
            return fail(ErrorCode::LayerNotFound, "the store has no layer " + layer.value);
        known->second.saved = saved;
        return {};
    }
    [[nodiscard]] Result<std::vector<NamespaceChange>> namespaceChanges(
        Revision revision) const override {
        const std::lock_guard lock(disk_->mutex);
        std::vector<NamespaceChange> changes;
        std::ranges::copy_if(disk_->namespaceChanges, std::back_inserter(changes),
                             [&](const auto& change) { return change.revision > revision; });
        return changes;
    }
    [[nodiscard]] Result<ClientRecord> clientRecord(const ClientId& id) const override {
        const std::lock_guard lock(disk_->mutex);
        ClientRecord record{{}, disk_->forgotten};
        std::map<std::uint64_t, Revision> known;
        if (const auto client = disk_->clients.find(id); client != disk_->clients.end())
            known = client->second;
        for (const auto& [transaction, revision] : disk_->late)
            if (transaction.client == id) known.emplace(transaction.sequence, revision);
        record.committed.assign(known.begin(), known.end());
        return record;
    }
    Result<std::size_t> forgetClients(std::size_t most, const std::set<ClientId>& kept) override {
        const std::lock_guard lock(disk_->mutex);
        if (disk_->clients.size() <= most) return 0;
        std::vector<std::pair<Revision, ClientId>> byAge;
        for (const auto& [client, numbers] : disk_->clients) {
            Revision newest = 0;
            for (const auto& [sequence, revision] : numbers) newest = std::max(newest, revision);
            for (const auto& [id, revision] : disk_->late)
                if (id.client == client) newest = std::max(newest, revision);
            byAge.emplace_back(newest, client);
        }
        std::ranges::sort(byAge);
        byAge.resize(byAge.size() - most / kForgetPart * (kForgetPart - 1));
        std::erase_if(byAge, [&](const auto& one) { return kept.contains(one.second); });
        for (const auto& old : byAge) {
            const ClientId& client = old.second;
            disk_->clients.erase(client);
            std::erase_if(disk_->late, [&](const auto& one) { return one.first.client == client; });
            disk_->forgotten = std::max(disk_->forgotten, old.first);
        }
        return byAge.size();
    }
    [[nodiscard]] Revision forgottenUpTo() const override {
        const std::lock_guard lock(disk_->mutex);
        return disk_->forgotten;
    }
    Result<void> addCheckpoint(const Checkpoint& checkpoint) override {
        const std::lock_guard lock(disk_->mutex);
        const bool known = disk_->checkpoints.contains(checkpoint.name);
        if (auto may = mayAdd(checkpoint, disk_->head.revision, known); !may) return may;
        disk_->checkpoints.emplace(checkpoint.name, checkpoint);
        return {};
    }
    [[nodiscard]] Result<std::vector<Checkpoint>> checkpoints() const override {
        const std::lock_guard lock(disk_->mutex);
        std::vector<Checkpoint> all;
        for (const auto& [name, checkpoint] : disk_->checkpoints) all.push_back(checkpoint);
        return all;
    }
    [[nodiscard]] Result<StoreSpace> space() const override {
        const std::lock_guard lock(disk_->mutex);
        StoreSpace space;
        for (const StoredCommit& commit : disk_->commits) space.log += commit.frame->size();
        for (const auto& [name, layer] : disk_->layers)
            space.layers.push_back({name, layer.base.dump().size(), layer.snapshotBytes});
        return space;
    }
    [[nodiscard]] bool hasSpace() const override { return true; }

private:
    [[nodiscard]] Result<StoredCommit> commitAt(Revision revision) const {
        const std::lock_guard lock(disk_->mutex);
        const Revision base = disk_->base.revision;
        if (revision <= base) return historyReplaced(revision, base);
        return disk_->commits[revision - base - 1];
    }
    template <class Predicate>
    [[nodiscard]] std::vector<LayerId> layersThat(Predicate predicate) const {
        const std::lock_guard lock(disk_->mutex);
        std::vector<LayerId> names;
        for (const auto& [name, layer] : disk_->layers)
            if (predicate(layer)) names.push_back(name);
        return names;
    }

    // The caller of the following functions holds the lock.

    /// Returns the stored content from which the content at `revision` is computed, and its
    /// revision.
    [[nodiscard]] std::pair<LayerDoc, Revision> beginning(const StoredLayer& layer,
                                                          Revision revision) const {
        const Revision base = disk_->base.revision;
        if (layer.snapshot && layer.snapshotRevision >= base && layer.snapshotRevision <= revision)
            return {*layer.snapshot, layer.snapshotRevision};
        return {layer.base, base};
    }
    /// Applies the commits (from, to] of the layer to `doc`. Returns their replayCost().
    [[nodiscard]] Result<std::size_t> follow(LayerDoc& doc, const LayerId& layer, Revision from,
                                             Revision to) const {
        std::size_t cost = 0;
        for (Revision at = from; at < to; ++at) {
            const StoredCommit& stored = disk_->commits[at - disk_->base.revision];
            const auto done = decodeCommit(stored).and_then([&](const Commit& commit) {
                cost += replayCost(stored.frame->size(), commit.edits.size());
                return replay(doc, layer, commit);
            });
            if (!done) return tl::unexpected(done.error());
        }
        return cost;
    }
    void add(const CommitRecord& commit) {
        disk_->commits.push_back({commit.revision, commit.frame, commit.hash});
        disk_->head.revision = commit.revision;
        disk_->head.hash = commit.hash;
        std::ranges::copy(commit.namespaceChanges, std::back_inserter(disk_->namespaceChanges));
        for (const LayerId& name : commit.layers) {
            StoredLayer& layer = disk_->layers[name];
            layer.changed = commit.revision;
            if (layer.first == 0) layer.first = commit.revision;
        }
        if (commit.saved) {
            SavedState& saved = disk_->layers[commit.saved->layer].saved;
            if (commit.saved->state.revision >= saved.revision) saved = commit.saved->state;
        }
        if (commit.id.sequence == 0) return;
        auto& numbers = disk_->clients[commit.id.client];
        numbers[commit.id.sequence] = commit.revision;
        const std::uint64_t last = numbers.rbegin()->first;
        if (last < kRemembered) return;
        if (last - commit.id.sequence >= kRemembered) disk_->late[commit.id] = commit.revision;
        numbers.erase(numbers.begin(), numbers.lower_bound(last - kRemembered + 1));
    }

    std::shared_ptr<MemoryDisk> disk_;
};

}  // namespace

std::shared_ptr<MemoryDisk> createMemoryDisk(StoreId identity) {
    return std::make_shared<MemoryDisk>(std::move(identity));
}

std::unique_ptr<CommitStore> createMemoryCommitStore(std::shared_ptr<MemoryDisk> disk) {
    return std::make_unique<MemoryCommitStore>(std::move(disk));
}

}  // namespace usdlive::server
