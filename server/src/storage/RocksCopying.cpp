// Copies the store while it is in use.
#include <rocksdb/utilities/checkpoint.h>

#include "storage/RocksCommitStoreImpl.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

// The space for a copy besides shared files: the log of RocksDB, and some small files.
constexpr std::uint64_t kCopyBytes = 8 * kMib;

/// Shares a file that never changes, or copies it to another file system.
Result<void> share(const fs::path& file, const fs::path& to) {
    std::error_code error;
    fs::create_hard_link(file, to, error);
    if (error) fs::copy_file(file, to, error);
    if (!error) return {};
    return fail(
        error == std::errc::no_space_on_device ? ErrorCode::StorageFull : ErrorCode::StorageFailed,
        "cannot copy " + file.string() + " to " + to.string() + ": " + error.message());
}

/// Shares all files of a folder. `mayVanish`: files that are removed meanwhile are left out.
Result<void> shareAll(const fs::path& folder, const fs::path& to, bool mayVanish) {
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
        if (entry->path().extension() == checkedfile::kDraft) continue;
        auto shared = share(entry->path(), to / entry->path().filename());
        std::error_code ignored;
        if (!shared && !(mayVanish && !fs::exists(entry->path(), ignored))) return shared;
    }
    if (!error) return {};
    return fail(ErrorCode::StorageFailed,
                "cannot read " + folder.string() + ": " + error.message());
}

}  // namespace

/// The snapshots are shared first, so that none of them is newer than the copied database, and the
/// bases last: none is removed while compact() does not run.
Result<void> RocksCommitStore::copyTo(const fs::path& folder) const {
    const std::lock_guard alone(compactMutex_);
    std::error_code error;
    if (fs::exists(folder, error))
        return fail(ErrorCode::InvalidArgument, folder.string() + " exists already");
    const auto copyDatabase = [&]() -> Result<void> {
        rocksdb::Checkpoint* made = nullptr;
        auto status = rocksdb::Checkpoint::Create(db_.get(), &made);
        const std::unique_ptr<rocksdb::Checkpoint> checkpoint(made);
        // The log is copied, not written to tables, which edits would wait for.
        if (status.ok())
            status = checkpoint->CreateCheckpoint((folder / "db").string(), ~std::uint64_t(0));
        if (status.ok()) return {};
        return tl::unexpected(rocksError(status, "copy", folder_.path()));
    };
    return checkFailed()
        .and_then([&] { return checkSpace(logBytes(folder_.database()) + kCopyBytes); })
        .and_then([&] { return makeFolders(folder / "snapshots"); })
        .and_then([&] { return makeFolders(folder / "base"); })
        .and_then([&] { return shareAll(folder_.snapshots(), folder / "snapshots", true); })
        .and_then(copyDatabase)
        .and_then([&] { return shareAll(folder_.bases(), folder / "base", false); })
        .and_then([&] { return share(folder_.path() / "format", folder / "format"); })
        .and_then([&] { return syncFolder(folder); });
}

}  // namespace usdlive::server
