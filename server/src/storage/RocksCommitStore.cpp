// Watches the disk space of the store and creates its errors.
#include <algorithm>

#include "storage/RocksCommitStoreImpl.h"

namespace usdlive::server {

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kSpaceCacheTime{100};
// With this much more than needed, the space is not measured again for a while.
constexpr std::uint64_t kPlenty = 1024 * kMib;
// The free space that append() keeps: half of the minimum, within these limits.
constexpr std::uint64_t kLeastMargin = 4 * kMib, kMostMargin = 64 * kMib;

}  // namespace

RocksCommitStore::~RocksCommitStore() {
    for (auto* handle : handles_) db_->DestroyColumnFamilyHandle(handle);
    if (db_) db_->Close().PermitUncheckedError();
}

RocksCommitStore::Space RocksCommitStore::measureSpace() const {
    std::uint64_t coming = background_->mergingBytes();  // bytes that wait for tables
    for (auto* handle : handles_) {
        std::uint64_t bytes = 0;
        db_->GetIntProperty(handle, rocksdb::DB::Properties::kCurSizeAllMemTables, &bytes);
        coming += bytes;
    }
    const std::lock_guard lock(spaceMutex_);
    const DiskSpace disk = diskSpace(folder_.path());
    Space space;
    const std::uint64_t wanted = minFree(options_.minFreeBytes, disk);
    space.margin = std::clamp(wanted / 2, kLeastMargin, kMostMargin);
    space.least = std::max(wanted, space.margin);
    const std::uint64_t usable = reserve_.usable(disk.free);
    space.usable = usable > coming ? usable - coming : 0;
    reserve_.adapt(disk.free, space.margin / 2, space.least);
    // Tables are merged only if enough space remains, also for what waits in memory.
    files_->SetMaxAllowedSpaceUsage(files_->GetTotalSize() + std::max(usable, kMib));
    files_->SetCompactionBufferSize(coming + space.margin);
    if (background_->hasStopped() && space.usable >= space.margin) resume();
    hasSpace_ = !background_->hasStopped() && space.usable >= space.least;
    plenty_ = hasSpace_ ? space.usable - space.least : 0;
    spaceTime_ = Clock::now();
    return space;
}

/// Lets RocksDB write again after its tables had reached the limit.
void RocksCommitStore::resume() const {
    const auto status = db_->Resume();
    if (status.ok() || status.IsBusy() || isFull(status)) return;
    const std::unique_lock lock(mutex_);
    failure_ = error(status, "write to");  // only opening the store again can help
    failure_->code = ErrorCode::StorageFailed;
}

Result<void> RocksCommitStore::checkSpace(std::uint64_t bytes) const {
    {
        const std::lock_guard lock(spaceMutex_);
        if (Clock::now() < spaceTime_ + kSpaceCacheTime && plenty_ >= kPlenty + kCopies * bytes &&
            !background_->hasStopped())
            return {};
    }
    const Space space = measureSpace();
    if (space.usable >= kCopies * bytes + space.margin) return {};
    if (const auto there = checkThere(); !there) return there;
    return fail(ErrorCode::StorageFull, "the disk of the store " + folder_.path().string() +
                                            " has " + std::to_string(space.usable / kMib) +
                                            " MiB left, which is too little. Free some space");
}

Result<StoreSpace> RocksCommitStore::space() const {
    const auto taken = [this](Family of) {
        std::uint64_t files = 0, memory = 0;
        db_->GetIntProperty(family(of), rocksdb::DB::Properties::kTotalSstFilesSize, &files);
        db_->GetIntProperty(family(of), rocksdb::DB::Properties::kSizeAllMemTables, &memory);
        return files + memory;
    };
    StoreSpace space{taken(Family::Commits),
                     taken(Family::Clients),
                     taken(Family::Meta),
                     diskSpace(folder_.path()).free,
                     {}};
    const auto size = [](const std::filesystem::path& file) -> std::uint64_t {
        std::error_code none;
        const auto bytes = std::filesystem::file_size(file, none);
        return none ? 0 : bytes;
    };
    const std::shared_lock lock(mutex_);
    for (const auto& [name, layer] : layers_) {
        const bool hasBase = layer.base.revision > 0;
        StoreSpace::Layer takes{name, 0, size(folder_.snapshot(layer.number))};
        if (hasBase) takes.base = size(folder_.base(layer.number, layer.base.revision));
        for (const Revision older : olderSnapshots(layer.number))
            takes.snapshots += size(folder_.snapshot(layer.number, older));
        space.layers.push_back(std::move(takes));
    }
    return space;
}

bool RocksCommitStore::hasSpace() const {
    {
        const std::lock_guard lock(spaceMutex_);
        if (Clock::now() < spaceTime_ + kSpaceCacheTime) return hasSpace_;
    }
    const Space space = measureSpace();
    // The space of a deleted folder is unknown; append() reports that error.
    return (space.usable >= space.least && !background_->hasStopped()) || !folder_.isThere();
}

Result<std::unique_ptr<CommitStore>> createRocksCommitStore(
    const std::filesystem::path& folder, const RocksCommitStoreOptions& options) {
    auto opened = StoreFolder::open(folder);
    if (!opened) return tl::unexpected(opened.error());
    auto store = std::make_unique<RocksCommitStore>(std::move(*opened), options);
    if (const auto done = store->open(); !done) return tl::unexpected(done.error());
    return store;
}

}  // namespace usdlive::server
