#pragma once

#include <filesystem>
#include <optional>

#include "Files.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The files that stand beside the database: `lock`, `format`, `head`, `reserve`, and those in
/// `snapshots` and `base`; and `db`, the database itself. Whoever has one, has the folder to
/// themselves.
class StoreFolder {
public:
    static constexpr std::uint32_t kFormat = 4;
    /// The oldest that is read. In 2 there is no base, until 3 no commit is compressed.
    static constexpr std::uint32_t kOldestFormat = 2;

    /// Errors: StorageLocked, StorageTooNew, StorageCorrupt (the format is not told, or
    /// older than what is read), or of the disk.
    [[nodiscard]] static Result<StoreFolder> open(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::filesystem::path database() const { return path_ / "db"; }
    [[nodiscard]] std::filesystem::path reserve() const { return path_ / "reserve"; }

    /// Of what a layer held, by its number.
    [[nodiscard]] std::filesystem::path snapshot(std::uint32_t layer) const {
        return snapshots() / std::to_string(layer);
    }

    /// An older one, of that revision.
    [[nodiscard]] std::filesystem::path snapshot(std::uint32_t layer, Revision revision) const {
        return snapshots() / (std::to_string(layer) + "-" + std::to_string(revision));
    }
    /// Of what a layer held at the revision of a base. Unlike a snapshot it must not be lost.
    [[nodiscard]] std::filesystem::path base(std::uint32_t layer, Revision revision) const {
        return bases() / (std::to_string(layer) + "-" + std::to_string(revision));
    }
    [[nodiscard]] std::filesystem::path bases() const { return path_ / "base"; }
    [[nodiscard]] std::filesystem::path snapshots() const { return path_ / "snapshots"; }

    /// The store is of kFormat from now on, durably.
    [[nodiscard]] Result<void> takeFormat();

    /// False: somebody has deleted the folder, moved it, or put another one in its place.
    [[nodiscard]] bool isThere() const;

    /// A commit that was acknowledged: what the database holds may not end before it. RocksDB takes
    /// a log that was cut off for one whose end was never written; this tells the difference.
    struct Mark {
        Revision revision = 0;
        Hash hash;
    };
    /// Nothing: not written yet, or not readable.
    [[nodiscard]] std::optional<Mark> mark() const;
    /// Written without sync, as any earlier mark does no harm. A failure is passed over for the
    /// same reason.
    void setMark(const Mark& mark);

private:
    StoreFolder() = default;
    [[nodiscard]] Result<void> lock();
    [[nodiscard]] Result<void> checkFormat();

    std::filesystem::path path_;
    std::uint32_t format_ = 0;
    File lock_, mark_;
};

}  // namespace usdlive::server
