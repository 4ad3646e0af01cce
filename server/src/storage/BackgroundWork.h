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
    /// Returns true if anything but a merge or a flush of tables has failed.
    [[nodiscard]] bool hasWriteFailed() const { return hasWriteFailed_; }

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
        if ((reason != Reason::kFlush && reason != Reason::kCompaction) || !isFull(*status))
            hasWriteFailed_ = true;
    }

private:
    std::atomic<std::uint64_t> mergingBytes_ = 0;
    std::atomic<bool> hasWriteFailed_ = false;
};

}  // namespace usdlive::server
