// File operations of the stores.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Returns true for the codes of errno by which a write fails on a full disk, or at a limit of the
/// user's or of the process.
[[nodiscard]] bool isDiskFull(int error);
/// Returns the error of errno as "cannot <verb> <path>: ...": StorageFull if the disk is full,
/// otherwise StorageFailed.
[[nodiscard]] Error systemError(const char* verb, const std::filesystem::path& path);

/// `flags` are those of open(2); the file is closed on exec.
[[nodiscard]] Result<Descriptor> openFile(const std::filesystem::path& path, int flags);
/// Creates the folder and its parents. Each survives a power cut.
[[nodiscard]] Result<void> makeFolders(const std::filesystem::path& path);

// Writes or reads everything, or returns an error. `path` names the file in the error.
[[nodiscard]] Result<void> writeAt(const Descriptor& file, std::uint64_t offset, ByteView bytes,
                                   const std::filesystem::path& path);
/// Returns up to `size` bytes, and fewer only at the end of the file.
[[nodiscard]] Result<Bytes> readAt(const Descriptor& file, std::uint64_t offset, std::size_t size,
                                   const std::filesystem::path& path);
[[nodiscard]] Result<void> syncFile(const Descriptor& file, const std::filesystem::path& path);
/// Makes files that were created or renamed in the folder survive a power cut.
[[nodiscard]] Result<void> syncFolder(const std::filesystem::path& path);

/// Files with a checksum: their content, then its SHA-256.
namespace checkedfile {

[[nodiscard]] Bytes encode(ByteView content);
/// Returns nothing if the bytes are damaged.
[[nodiscard]] std::optional<Bytes> decode(ByteView encoded);
inline constexpr const char* kDraft = ".new";  ///< suffix of the name while a file is being written
/// Returns nothing if the file is missing or damaged.
[[nodiscard]] std::optional<Bytes> read(const std::filesystem::path& path);
/// Writes the file durably. After an error it has its old content.
[[nodiscard]] Result<void> replace(const std::filesystem::path& path, ByteView content);

}  // namespace checkedfile
}  // namespace usdlive::server
