// Measures the disk space of a store.
#include "app/StorageUse.h"

#include <map>
#include <unordered_map>

#include "project/CommitContent.h"

namespace usdlive::server {

namespace {

/// Adds up the sizes of layers from commits and bases.
class LayerUses {
public:
    void add(const Commit& commit, std::size_t bytes) {
        std::map<LayerId, std::size_t> edits;
        for (const Edit& edit : commit.edits) {
            ++edits[edit.layer];
            forEachBlob(edit.action, [&](const Value& blob) { add(edit.layer, blob); });
        }
        frames_ += bytes;
        for (const auto& [layer, count] : edits) {
            Use& use = uses_[layer];
            ++use.commits;
            use.frames += double(bytes) * double(count) / double(commit.edits.size());
        }
    }
    void add(const LayerId& layer, const LayerDoc& base) {
        forEachBlob(base, [&](const Value& blob) { add(layer, blob); });
    }
    [[nodiscard]] LayerStorage of(const StoreSpace::Layer& layer, std::uint64_t log) const {
        LayerStorage storage{layer.layer, 0, 0, layer.base, layer.snapshots, 0, 0};
        const auto found = uses_.find(layer.layer);
        if (found == uses_.end()) return storage;
        const Use& use = found->second;
        storage.commits = use.commits;
        if (frames_ > 0) storage.log = std::uint64_t(double(log) * use.frames / double(frames_));
        storage.blobs = use.blobs.size();
        for (const auto& [hash, bytes] : use.blobs) storage.blobBytes += bytes;
        return storage;
    }

private:
    struct Use {
        std::uint64_t commits = 0;
        double frames = 0;
        std::unordered_map<Hash, std::uint64_t> blobs;  // and their bytes
    };

    void add(const LayerId& layer, const Value& blob) {
        uses_[layer].blobs[blob.hash()] = blob.size();
    }

    std::map<LayerId, Use> uses_;
    std::uint64_t frames_ = 0;  // bytes of all commits
};

void addFiles(Storage& storage, const std::filesystem::path& folder) {
    std::error_code error;
    for (std::filesystem::recursive_directory_iterator at(folder, error), end; !error && at != end;
         at.increment(error)) {
        std::error_code gone;
        if (!at->is_regular_file(gone) || gone) continue;
        const auto bytes = at->file_size(gone);
        if (gone) continue;
        ++storage.blobs;
        storage.blobBytes += bytes;
    }
}

}  // namespace

Result<Storage> measureStorage(const CommitStore& store, const std::filesystem::path& blobs,
                               const CommitStore::KeepRunning& keepRunning) {
    LayerUses uses;
    Storage storage;
    Result<void> counted;
    storage.base = store.base().revision;
    storage.revision = store.head().revision;
    const auto read = store.read(0, storage.revision, [&](const StoredCommit& stored) {
        counted = decodeCommit(stored).and_then([&](const Commit& commit) -> Result<void> {
            if (!keepRunning()) return fail(ErrorCode::ShuttingDown, "the server is stopping");
            if (storage.oldestMs == 0) storage.oldestMs = std::uint64_t(commit.timeMs);
            uses.add(commit, stored.frame->size());
            return {};
        });
        return bool(counted);
    });
    if (!read) return tl::unexpected(read.error());
    if (!counted) return tl::unexpected(counted.error());

    const auto space = store.space();
    if (!space) return tl::unexpected(space.error());
    storage.log = space->log;
    storage.clients = space->clients;
    storage.records = space->records;
    storage.free = space->free;
    for (const StoreSpace::Layer& layer : space->layers) {
        if (layer.base > 0) {
            const auto held = store.layerAt(layer.layer, storage.base);
            if (!held) return tl::unexpected(held.error());
            if (*held) uses.add(layer.layer, **held);
        }
        storage.bases += layer.base;
        storage.snapshots += layer.snapshots;
        storage.layers.push_back(uses.of(layer, storage.log));
    }
    addFiles(storage, blobs);
    return storage;
}

}  // namespace usdlive::server
