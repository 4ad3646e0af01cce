// The simulated disk of the server.
#pragma once

#include <algorithm>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "project/CommitContent.h"
#include "storage/BlobStore.h"
#include "storage/MemoryCommitStore.h"

namespace usdlive::simulation {

/// The storage that outlives the server's processes, and that can fail. Everything that append()
/// has taken is durable.
class SimDisk {
public:
    bool full = false;         ///< append() fails with StorageFull
    bool reportsSpace = true;  ///< the answer when the server asks whether there is space
    bool failed = false;  ///< append() fails with StorageFailed until the store is opened again
    bool forgot = false;  ///< it has lost a commit that it had taken
    const std::unique_ptr<server::BlobStore> blobs = server::createMemoryBlobStore();

    SimDisk() = default;
    /// Copies the commits to another disk, without the big values.
    SimDisk(const SimDisk& other)
        : full(other.full),
          reportsSpace(other.reportsSpace),
          failed(other.failed),
          commits_(other.commits_) {
        writeAnew(*other.store_, other.store_->head().epoch);
    }

    /// Opens the disk for a new server process.
    void open() {
        failed = false;
        store_ = server::createMemoryCommitStore(disk_);
    }
    [[nodiscard]] server::CommitStore& store() const { return *store_; }

    Result<void> append(std::span<const server::CommitRecord> commits) {
        if (failed) return fail(ErrorCode::StorageFailed, "the simulated disk is broken");
        if (full) return fail(ErrorCode::StorageFull, "the simulated disk is full");
        auto done = store_->append(commits);
        if (done) commits_.insert(commits_.end(), commits.begin(), commits.end());
        return done;
    }

    /// Drops big values, which return with an older history: a backup has those of then.
    void drop(const std::vector<Hash>& values) {
        for (const Hash& hash : values)
            if (const auto size = blobs->size(hash))
                if (auto value = blobs->read(hash, 0, std::size_t(*size)))
                    dropped_.insert_or_assign(hash, std::move(*value));
        blobs->drop(values);
    }

    /// Forgets the newest commits, like a disk that reported a sync falsely, or (`older`) like a
    /// copy that was made before its last opening. Open it again afterwards.
    void rollBack(Revision to, bool older = false) {
        commits_.resize(std::min<std::size_t>(commits_.size(), to));
        forget();
        const auto before = std::exchange(store_, nullptr);
        writeAnew(*before, before->head().epoch - (older ? 1 : 0));
    }

    /// The history on a disk.
    struct History {
        std::shared_ptr<server::MemoryDisk> disk =
            server::createMemoryDisk(StoreId(std::string(32, 'b')));
        std::vector<server::CommitRecord> commits;
    };
    /// Returns a copy of the history, as a backup of the stopped server has it. It has the same
    /// identity, and the same epoch or (`older`) an earlier one. Big values are not copied.
    [[nodiscard]] History copy(bool older) const {
        SimDisk copied(*this);
        if (older) {
            const auto before = std::exchange(copied.store_, nullptr);
            copied.writeAnew(*before, 0);
        }
        return {std::move(copied.disk_), std::move(copied.commits_)};
    }
    /// Replaces the history, and returns the one before. Open the disk again afterwards.
    History put(History other) {
        store_.reset();
        forget();
        return {std::exchange(disk_, std::move(other.disk)),
                std::exchange(commits_, std::move(other.commits))};
    }

    /// All durable commits, also those that a base replaced.
    [[nodiscard]] const std::vector<server::CommitRecord>& commits() const { return commits_; }

private:
    void forget() {
        forgot = true;
        for (const auto& [hash, value] : std::exchange(dropped_, {}))
            (void)blobs->write(hash, value.size(), 0, value);
    }
    void writeAnew(const server::CommitStore& before, Epoch epoch) {
        disk_ = server::createMemoryDisk(before.identity());
        store_ = server::createMemoryCommitStore(disk_);
        (void)store_->append(commits_);
        const auto checkpoints = before.checkpoints();
        for (const Checkpoint& one : *checkpoints)
            if (one.revision <= commits_.size()) (void)store_->addCheckpoint(one);
        (void)store_->compact(std::min<Revision>(before.base().revision, commits_.size()),
                              [] { return true; });
        // A store has been opened by the server that made its newest commit (SE3).
        if (!commits_.empty()) {
            const server::CommitRecord& newest = commits_.back();
            const auto commit = server::decodeCommit({newest.revision, newest.frame, newest.hash});
            epoch = std::max(epoch, commit->epoch);
        }
        while (store_->head().epoch < epoch) store_ = server::createMemoryCommitStore(disk_);
    }

    // The identities are not random, so that a run can be repeated.
    std::shared_ptr<server::MemoryDisk> disk_ =
        server::createMemoryDisk(StoreId(std::string(32, 'a')));
    std::unique_ptr<server::CommitStore> store_ = server::createMemoryCommitStore(disk_);
    std::vector<server::CommitRecord> commits_;
    std::map<Hash, Bytes> dropped_;
};

}  // namespace usdlive::simulation
