#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::client {

/// A file of records that are only appended: each is u32 size, the first 8 bytes of the SHA-256 of
/// its payload, and the payload. A record that was torn by a crash ends the file: it and what
/// follows is not read, and the next record takes its place.
///
/// One thread at a time.
class RecordFile {
public:
    RecordFile() = default;
    RecordFile(RecordFile&& other) noexcept;
    RecordFile& operator=(RecordFile&& other) noexcept;
    ~RecordFile();

    enum class Mode { New, Existing };
    /// Opens the file for this process alone (a lock that ends with the process). InvalidArgument
    /// when it cannot be opened; StorageLocked when another process, or another object, has it.
    [[nodiscard]] static Result<RecordFile> open(const std::filesystem::path& path, Mode mode);

    /// Calls `each` for every whole record: its number of bytes into the file, and its payload.
    Result<void> readAll(const std::function<void(std::uint64_t at, ByteView payload)>& each);
    [[nodiscard]] Result<Bytes> read(std::uint64_t at) const;

    /// Appends records with one write; returns where each begins. StorageFailed leaves the file as
    /// it was.
    Result<std::vector<std::uint64_t>> append(const std::vector<Bytes>& payloads);
    /// Returns when what was appended is on the disk.
    Result<void> sync();
    Result<void> truncate(std::uint64_t size);

    [[nodiscard]] bool isOpen() const { return file_ >= 0; }
    [[nodiscard]] std::uint64_t size() const { return size_; }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Renames the file over another one.
    Result<void> moveTo(const std::filesystem::path& path);
    void remove();

private:
    [[nodiscard]] Error failed(const char* what) const;

    std::filesystem::path path_;
    int file_ = -1;
    std::uint64_t size_ = 0;
};

}  // namespace usdlive::client
