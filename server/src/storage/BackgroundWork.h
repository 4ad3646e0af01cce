// Follows the background work of RocksDB.
#pragma once

#include <rocksdb/listener.h>

#include <atomic>
#include <cstdint>
#include <filesystem>

namespace usdlive::server {

/// Returns true if a write found the disk, or the limit of the tables, full.
[[nodiscard]] inline bool isFull(const rocksdb::Status& status) {
    return status.subcode() == rocksdb::Status::SubCode::kNoSpace ||
           status.subcode() == rocksdb::Status::SubCode::kSpaceLimit;
}

/// RocksDB calls it on its own threads and in writes.
class BackgroundWork final : public rocksdb::EventListener {
public:
    /// Returns how much space the merge of tables that runs now takes at most. 0: none runs.
    [[nodiscard]] std::uint64_t mergingBytes() const { return mergingBytes_; }
    /// Returns true if a commit could not be written, or tables for another reason than a full
    /// disk.
    [[nodiscard]] bool hasWriteFailed() const { return hasWriteFailed_; }
    /// Returns true if tables found the disk, or their limit, full. RocksDB then writes no more
    /// until DB::Resume() succeeds.
    [[nodiscard]] bool hasStopped() const { return hasStopped_; }
    /// Call it when a write was refused for that reason.
    void setStopped() { hasStopped_ = true; }

    void OnCompactionBegin(rocksdb::DB*, const rocksdb::CompactionJobInfo& merge) override {
        std::uint64_t bytes = 0;
        std::error_code ignored;
        for (const auto& file : merge.input_files) {
            const auto size = std::filesystem::file_size(file, ignored);
            if (!ignored) bytes += size;
        }
        mergingBytes_ = bytes;  // one runs at a time (max_background_jobs)
    }
    void OnCompactionCompleted(rocksdb::DB*, const rocksdb::CompactionJobInfo&) override {
        mergingBytes_ = 0;
    }
    void OnBackgroundError(rocksdb::BackgroundErrorReason reason,
                           rocksdb::Status* status) override {
        using Reason = rocksdb::BackgroundErrorReason;
        const bool isWrite = reason == Reason::kWriteCallback || reason == Reason::kMemTable;
        (!isWrite && isFull(*status) ? hasStopped_ : hasWriteFailed_) = true;
    }
    /// Leaves the recovery to the store, which knows what space it needs. RocksDB's own could run
    /// on for ever, and closing the database waited for it.
    void OnErrorRecoveryBegin(rocksdb::BackgroundErrorReason, rocksdb::Status,
                              bool* recovers) override {
        *recovers = false;
    }
    void OnErrorRecoveryEnd(const rocksdb::BackgroundErrorRecoveryInfo& recovery) override {
        if (recovery.new_bg_error.ok()) hasStopped_ = false;
    }

private:
    std::atomic<std::uint64_t> mergingBytes_ = 0;
    std::atomic<bool> hasWriteFailed_ = false;
    std::atomic<bool> hasStopped_ = false;
};

}  // namespace usdlive::server
