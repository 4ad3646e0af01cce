// A file of checked records that are only appended.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// A file of records that are only appended. A record is a u32 size, the first 8 bytes of the
/// SHA-256 of its payload, and the payload. A record that a crash has cut off ends the file: it and
/// everything behind it is not read, and the next record overwrites it.
///
/// Used by one thread at a time.
class RecordFile {
public:
    RecordFile() = default;
    RecordFile(RecordFile&& other) noexcept;
    RecordFile& operator=(RecordFile&& other) noexcept;

    enum class Mode { New, Existing };
    /// Opens and locks the file until the object or the process ends. Errors: InvalidArgument (it
    /// cannot be opened), StorageLocked (another process or object has it open).
    [[nodiscard]] static Result<RecordFile> open(const std::filesystem::path& path, Mode mode);

    /// Calls `each` for every complete record, with its position in bytes and its payload. Error:
    /// StorageCorrupt (a complete record is damaged: it and everything behind it is not read, and
    /// stays).
    Result<void> readAll(const std::function<void(std::uint64_t at, ByteView payload)>& each);
    [[nodiscard]] Result<Bytes> read(std::uint64_t at) const;

    /// Appends records with one write. Returns their positions. Error: StorageFailed; the file is
    /// unchanged then.
    Result<std::vector<std::uint64_t>> append(const std::vector<Bytes>& payloads);
    /// Waits until all appended records are on the disk.
    Result<void> sync();
    Result<void> truncate(std::uint64_t size);

    [[nodiscard]] bool isOpen() const { return bool(file_); }
    [[nodiscard]] std::uint64_t size() const { return size_; }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Renames the file over another one.
    Result<void> moveTo(const std::filesystem::path& path);
    void remove();

private:
    [[nodiscard]] Error failed(const char* what) const;

    std::filesystem::path path_;
    Descriptor file_;
    std::uint64_t size_ = 0;
};

}  // namespace usdlive::client
