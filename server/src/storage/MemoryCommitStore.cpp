#include "usdlive/server/storage/MemoryCommitStore.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "StoreRules.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

namespace {

struct NodeRecord {
    NodeId parent = 0;
    std::uint64_t order = 0;
    SpecKind kind{};
    std::string name;
};

/// The records of a layer.
class StoredLayer {
public:
    Revision changed = 0;
    SavedState saved;

    void apply(const PutNode& change) {
        nodes_[change.node] = {change.parent, change.order, change.kind, change.name};
    }
    void apply(const EraseNodes& change) {
        for (const NodeId node : change.nodes) {
            nodes_.erase(node);
            fields_.erase(node);
        }
    }
    void apply(const PutField& change) { fields_[change.node][change.field] = change.value; }
    void apply(const EraseField& change) { fields_[change.node].erase(change.field); }
    void apply(const PutSample& change) {
        FieldValue& field = fields_[change.node][change.field];
        if (!field.as<TimeSamples>()) field = TimeSamples{};
        auto& samples = field.as<TimeSamples>()->samples;
        const auto at = sampleAt(samples, change.time);
        if (at != samples.end() && at->first == change.time)
            at->second = change.value;
        else
            samples.emplace(at, change.time, change.value);
    }
    void apply(const EraseSample& change) {
        auto& fields = fields_[change.node];
        const auto field = fields.find(change.field);
        auto* content = field == fields.end() ? nullptr : field->second.as<TimeSamples>();
        if (!content) return;
        auto& samples = content->samples;
        const auto at = sampleAt(samples, change.time);
        if (at == samples.end() || at->first != change.time) return;
        samples.erase(at);
        if (samples.empty()) fields.erase(field);
    }

    void apply(const PutLayer& change) {
        change.doc.visit([this](const LayerDoc::SpecView& spec) {
            if (spec.kind != SpecKind::PseudoRoot)
                nodes_[spec.node] = {spec.parent, spec.order, spec.kind, std::string(spec.name)};
            for (const auto& [field, value] : *spec.fields) fields_[spec.node][field] = value;
        });
    }

    [[nodiscard]] Result<LayerDoc> load() const {
        LayerDoc::Builder builder;
        std::multimap<NodeId, NodeId> children;
        for (const auto& [id, node] : nodes_) children.emplace(node.parent, id);
        std::vector<NodeId> parents{kRootNode};
        while (!parents.empty()) {
            const auto [begin, end] = children.equal_range(parents.back());
            parents.pop_back();
            for (auto child = begin; child != end; ++child) {
                const NodeRecord& node = nodes_.at(child->second);
                const auto added =
                    builder.addSpec(child->second, node.parent, node.order, node.kind, node.name);
                if (!added) return tl::unexpected(added.error());
                parents.push_back(child->second);
            }
        }
        for (const auto& [node, fields] : fields_)
            for (const auto& [name, value] : fields)
                if (const auto added = builder.addField(node, name, value); !added)
                    return tl::unexpected(added.error());
        return builder.finish();
    }

private:
    static std::vector<std::pair<double, Value>>::iterator sampleAt(
        std::vector<std::pair<double, Value>>& samples, double time) {
        return std::lower_bound(
            samples.begin(), samples.end(), time,
            [](const auto& sample, double wanted) { return sample.first < wanted; });
    }

    std::map<NodeId, NodeRecord> nodes_;
    std::map<NodeId, std::map<std::string, FieldValue>> fields_;
};

}  // namespace

class MemoryDisk {
public:
    std::mutex mutex;  // guards all below
    CommitStore::Head head;
    std::vector<StoredCommit> commits;
    std::vector<NamespaceChange> namespaceChanges;
    std::map<LayerId, StoredLayer> layers;
    std::map<ClientId, std::map<std::uint64_t, Revision>> clients;
    std::map<std::string, Checkpoint> checkpoints;
};

namespace {

class MemoryCommitStore final : public CommitStore {
public:
    explicit MemoryCommitStore(std::shared_ptr<MemoryDisk> disk) : disk_(std::move(disk)) {
        const std::lock_guard lock(disk_->mutex);
        ++disk_->head.epoch;
    }

    [[nodiscard]] Head head() const override {
        const std::lock_guard lock(disk_->mutex);
        return disk_->head;
    }
    Result<void> append(std::span<const CommitRecord> commits) override {
        const std::lock_guard lock(disk_->mutex);
        if (const auto fits = mayAppend(commits, disk_->head); !fits) return fits;
        for (const CommitRecord& commit : commits) add(commit);
        return {};
    }
    Result<void> read(Revision from, Revision to,
                      const std::function<bool(const StoredCommit&)>& visit) const override {
        for (Revision next = std::max<Revision>(from, 1); next <= std::min(to, head().revision);
             ++next)
            if (!visit(commitAt(next))) break;
        return {};
    }
    [[nodiscard]] Result<Hash> hashAt(Revision revision) const override {
        if (revision == 0) return Hash{};
        if (revision > head().revision)
            return fail(ErrorCode::FutureRevision,
                        "there is no commit " + std::to_string(revision) + " yet");
        return commitAt(revision).hash;
    }
    [[nodiscard]] Result<std::vector<LayerId>> layers() const override {
        return layersThat([](const StoredLayer&) { return true; });
    }
    [[nodiscard]] Result<std::vector<LayerId>> unsavedLayers() const override {
        return layersThat(
            [](const StoredLayer& layer) { return layer.changed > layer.saved.revision; });
    }
    [[nodiscard]] Result<std::optional<LayerDoc>> loadLayer(const LayerId& layer) const override {
        const std::lock_guard lock(disk_->mutex);
        const auto known = disk_->layers.find(layer);
        if (known == disk_->layers.end()) return std::optional<LayerDoc>();
        return known->second.load().map(
            [](LayerDoc&& doc) { return std::optional(std::move(doc)); });
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
            return fail(ErrorCode::LayerNotFound, "the store holds no layer " + layer.value);
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
    [[nodiscard]] Result<std::optional<Revision>> committed(
        const TransactionId& transaction) const override {
        const std::lock_guard lock(disk_->mutex);
        const auto client = disk_->clients.find(transaction.client);
        if (client == disk_->clients.end()) return std::optional<Revision>();
        const auto known = client->second.find(transaction.sequence);
        return known == client->second.end() ? std::nullopt : std::optional(known->second);
    }
    [[nodiscard]] Result<std::uint64_t> lastSequence(const ClientId& id) const override {
        const std::lock_guard lock(disk_->mutex);
        const auto client = disk_->clients.find(id);
        if (client == disk_->clients.end() || client->second.empty()) return 0;
        return client->second.rbegin()->first;
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
    [[nodiscard]] bool hasSpace() const override { return true; }

private:
    [[nodiscard]] StoredCommit commitAt(Revision revision) const {
        const std::lock_guard lock(disk_->mutex);
        return disk_->commits[revision - 1];
    }
    template <class Predicate>
    [[nodiscard]] std::vector<LayerId> layersThat(Predicate predicate) const {
        const std::lock_guard lock(disk_->mutex);
        std::vector<LayerId> names;
        for (const auto& [name, layer] : disk_->layers)
            if (predicate(layer)) names.push_back(name);
        return names;
    }

    // The lock is held from here on.
    void add(const CommitRecord& commit) {
        disk_->commits.push_back({commit.revision, commit.frame, commit.hash});
        disk_->head.revision = commit.revision;
        disk_->head.hash = commit.hash;
        std::ranges::copy(commit.namespaceChanges, std::back_inserter(disk_->namespaceChanges));
        for (const StateChange& change : commit.changes)
            std::visit(
                [&](const auto& one) {
                    StoredLayer& layer = disk_->layers[one.layer];
                    layer.apply(one);
                    layer.changed = commit.revision;
                },
                change);
        if (commit.saved) {
            SavedState& saved = disk_->layers[commit.saved->layer].saved;
            if (commit.saved->state.revision >= saved.revision) saved = commit.saved->state;
        }
        auto& numbers = disk_->clients[commit.id.client];
        numbers[commit.id.sequence] = commit.revision;
        const std::uint64_t last = numbers.rbegin()->first;
        if (last >= kRemembered)
            numbers.erase(numbers.begin(), numbers.lower_bound(last - kRemembered + 1));
    }

    std::shared_ptr<MemoryDisk> disk_;
};

}  // namespace

std::shared_ptr<MemoryDisk> createMemoryDisk() { return std::make_shared<MemoryDisk>(); }

std::unique_ptr<CommitStore> createMemoryCommitStore(std::shared_ptr<MemoryDisk> disk) {
    return std::make_unique<MemoryCommitStore>(std::move(disk));
}

}  // namespace usdlive::server
