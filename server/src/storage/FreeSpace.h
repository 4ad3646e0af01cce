#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace usdlive::server {

/// What is free on the disk that holds `folder`, and how large it is. Bytes.
struct DiskSpace {
    std::uint64_t free = 0, total = 0;
};
/// A disk that cannot be asked has no space.
[[nodiscard]] DiskSpace diskSpace(const std::filesystem::path& folder);

/// `given`, or 512 MiB, or 2 % of the disk if that is more.
[[nodiscard]] std::uint64_t minFree(const std::optional<std::uint64_t>& given,
                                    const DiskSpace& disk);

/// A file that only takes space, given up while the disk is full.
class Reserve {
public:
    Reserve(std::filesystem::path path, std::uint64_t bytes);

    /// The free space without what the reserve still wants to have back.
    [[nodiscard]] std::uint64_t usable(std::uint64_t free) const {
        const std::uint64_t missing = there_ ? 0 : bytes_;
        return free > missing ? free - missing : 0;
    }
    /// Deletes the file when less than `low` bytes are free, makes it again when `high` are usable.
    void adapt(std::uint64_t free, std::uint64_t low, std::uint64_t high);

private:
    void make();

    std::filesystem::path path_;
    std::uint64_t bytes_;
    bool there_ = false;
};

}  // namespace usdlive::server
