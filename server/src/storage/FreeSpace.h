// Measures the free space of a disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace usdlive::server {

/// The free space and the size of the disk that holds `folder`, in bytes.
struct DiskSpace {
    std::uint64_t free = 0, total = 0;
};
/// Returns zeros if the disk cannot be queried.
[[nodiscard]] DiskSpace diskSpace(const std::filesystem::path& folder);

/// Returns `given`. Default: 512 MiB, or 2 % of the disk if that is more.
[[nodiscard]] std::uint64_t minFree(const std::optional<std::uint64_t>& given,
                                    const DiskSpace& disk);

/// A file that reserves space and is deleted while the disk is full.
class Reserve {
public:
    Reserve(std::filesystem::path path, std::uint64_t bytes);

    /// Returns the free space without the part that a deleted reserve will take again.
    [[nodiscard]] std::uint64_t usable(std::uint64_t free) const {
        const std::uint64_t missing = there_ ? 0 : bytes_;
        return free > missing ? free - missing : 0;
    }
    /// Deletes the file if less than `low` bytes are free. Creates it again if `high` bytes are
    /// usable.
    void adapt(std::uint64_t free, std::uint64_t low, std::uint64_t high);

private:
    void make();

    std::filesystem::path path_;
    std::uint64_t bytes_;
    bool there_ = false;
};

}  // namespace usdlive::server
