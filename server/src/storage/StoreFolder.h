// The files of a store next to its database.
#pragma once

#include <filesystem>
#include <optional>

#include "storage/Files.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The files beside the database: `lock`, `format`, `head`, `reserve`, the folders `snapshots` and
/// `base`, and the database itself in `db`. While one exists, no other process or store can open
/// the folder.
class StoreFolder {
public:
    static constexpr std::uint32_t kFormat = 5;
    /// The oldest format that can be read. Format 2 has no base; formats up to 3 have no compressed
    /// commits, up to 4 no edits of places (M15).
    static constexpr std::uint32_t kOldestFormat = 2;

    /// Errors: StorageLocked, StorageTooNew, StorageCorrupt (the format is unknown or too old), or
    /// those of the disk.
    [[nodiscard]] static Result<StoreFolder> open(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::filesystem::path database() const { return path_ / "db"; }
    [[nodiscard]] std::filesystem::path reserve() const { return path_ / "reserve"; }

    /// Returns the path of a layer's snapshot, by the layer's number.
    [[nodiscard]] std::filesystem::path snapshot(std::uint32_t layer) const {
        return snapshots() / std::to_string(layer);
    }

    /// Returns the path of the older snapshot at that revision.
    [[nodiscard]] std::filesystem::path snapshot(std::uint32_t layer, Revision revision) const {
        return snapshots() / (std::to_string(layer) + "-" + std::to_string(revision));
    }
    /// Returns the path of a layer's content at a base. Unlike a snapshot it must not be lost.
    [[nodiscard]] std::filesystem::path base(std::uint32_t layer, Revision revision) const {
        return bases() / (std::to_string(layer) + "-" + std::to_string(revision));
    }
    [[nodiscard]] std::filesystem::path bases() const { return path_ / "base"; }
    [[nodiscard]] std::filesystem::path snapshots() const { return path_ / "snapshots"; }

    /// Marks the store as being of kFormat, durably.
    [[nodiscard]] Result<void> takeFormat();

    /// Returns false if the folder was deleted, moved or replaced.
    [[nodiscard]] bool isThere() const;

    /// An acknowledged commit; the database must not end before it. RocksDB cannot distinguish a
    /// truncated log from one whose end was never written, but this can.
    struct Mark {
        Revision revision = 0;
        Hash hash;
    };
    /// Returns nothing if it was not written yet or is unreadable.
    [[nodiscard]] std::optional<Mark> mark() const;
    /// Writes the mark without sync and ignores failures, because an older mark does no harm.
    void setMark(const Mark& mark);

private:
    StoreFolder() = default;
    [[nodiscard]] Result<void> lock();
    [[nodiscard]] Result<void> checkFormat();

    std::filesystem::path path_;
    std::uint32_t format_ = 0;
    Descriptor lock_, mark_;
};

}  // namespace usdlive::server
