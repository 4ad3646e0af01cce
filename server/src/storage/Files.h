#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <utility>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// An open file of the system, closed at the end.
class File {
public:
    File() = default;
    explicit File(int descriptor) : descriptor_(descriptor) {}
    File(File&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
    File& operator=(File&& other) noexcept {
        std::swap(descriptor_, other.descriptor_);
        return *this;
    }
    ~File();

    [[nodiscard]] int get() const { return descriptor_; }

private:
    int descriptor_ = -1;
};

/// What errno says, as "cannot <verb> <path>: ...": StorageFull when the disk is, else
/// StorageFailed.
[[nodiscard]] Error systemError(const char* verb, const std::filesystem::path& path);

/// `flags` as of open(2); closed on exec.
[[nodiscard]] Result<File> openFile(const std::filesystem::path& path, int flags);
/// With those above it; each is there after a power cut, too.
[[nodiscard]] Result<void> makeFolders(const std::filesystem::path& path);

// Whole or an error; `path` names the file in it.
[[nodiscard]] Result<void> writeAt(const File& file, std::uint64_t offset, ByteView bytes,
                                   const std::filesystem::path& path);
/// Up to `size` bytes: fewer at the end of the file.
[[nodiscard]] Result<Bytes> readAt(const File& file, std::uint64_t offset, std::size_t size,
                                   const std::filesystem::path& path);
[[nodiscard]] Result<void> syncFile(const File& file, const std::filesystem::path& path);
/// So that a file made or renamed in it is there after a power cut.
[[nodiscard]] Result<void> syncFolder(const std::filesystem::path& path);

/// Files that are known to be whole: their content, then its SHA-256.
namespace sealedfile {

[[nodiscard]] Bytes seal(ByteView content);
/// Nothing: damaged.
[[nodiscard]] std::optional<Bytes> unseal(ByteView sealed);
inline constexpr const char* kDraft = ".new";  ///< how the name of one that is being written ends
/// Nothing: missing or damaged.
[[nodiscard]] std::optional<Bytes> read(const std::filesystem::path& path);
/// The file holds the content, sealed and durable, or what it held before.
[[nodiscard]] Result<void> replace(const std::filesystem::path& path, ByteView content);

}  // namespace sealedfile
}  // namespace usdlive::server
