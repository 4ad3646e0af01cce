// The folder of a store: its lock, format and mark.
#include "storage/StoreFolder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kMostBytes = 4096;  // size limit of a file with a checksum

}  // namespace

Result<StoreFolder> StoreFolder::open(const std::filesystem::path& path) {
    StoreFolder folder;
    folder.path_ = path;
    auto done = makeFolders(folder.snapshots())
                    .and_then([&] { return makeFolders(folder.bases()); })
                    .and_then([&] { return folder.lock(); })
                    .and_then([&] { return folder.checkFormat(); });
    if (!done) return tl::unexpected(done.error());
    std::error_code ignored;  // unfinished drafts only take space
    for (const auto& files : {folder.snapshots(), folder.bases()})
        for (const auto& entry : std::filesystem::directory_iterator(files, ignored))
            if (entry.path().extension() == checkedfile::kDraft)
                std::filesystem::remove(entry.path(), ignored);
    auto mark = openFile(path / "head", O_RDWR | O_CREAT);
    if (!mark) return tl::unexpected(mark.error());
    folder.mark_ = std::move(*mark);
    return folder;
}

// Locks the open file and not the process, so that a second store in this process is refused, too.
Result<void> StoreFolder::lock() {
    const auto name = path_ / "lock";
    auto file = openFile(name, O_RDWR | O_CREAT);
    if (!file) return tl::unexpected(file.error());
    if (::flock(file->get(), LOCK_EX | LOCK_NB) != 0) {
        if (errno != EWOULDBLOCK) return tl::unexpected(systemError("lock", name));
        return fail(ErrorCode::StorageLocked,
                    "the store " + path_.string() + " is open in another process");
    }
    lock_ = std::move(*file);
    return {};
}

Result<void> StoreFolder::takeFormat() {
    if (format_ == kFormat) return {};
    Bytes content;
    appendNumber<std::uint32_t>(content, kFormat);
    format_ = kFormat;
    return checkedfile::replace(path_ / "format", content);
}

Result<void> StoreFolder::checkFormat() {
    const auto name = path_ / "format";
    if (!std::filesystem::exists(name) && !std::filesystem::exists(database())) return takeFormat();
    const auto file = openFile(name, O_RDONLY);
    const auto encoded = file ? readAt(*file, 0, kMostBytes, name) : Result<Bytes>(Bytes());
    const auto content = encoded ? checkedfile::decode(*encoded) : std::nullopt;
    if (!content)
        return fail(ErrorCode::StorageCorrupt, "the format of the store is unknown: " +
                                                   name.string() + " is missing or damaged");
    ByteReader in(*content);
    format_ = in.u32();
    if (format_ >= kOldestFormat && format_ <= kFormat) return {};
    return fail(format_ > kFormat ? ErrorCode::StorageTooNew : ErrorCode::StorageCorrupt,
                "the store " + path_.string() + " has format " + std::to_string(format_) +
                    ", but this version reads " + std::to_string(kOldestFormat) + " to " +
                    std::to_string(kFormat));
}

bool StoreFolder::isThere() const {
    struct stat opened{}, named{};
    return ::fstat(lock_.get(), &opened) == 0 && ::stat((path_ / "lock").c_str(), &named) == 0 &&
           opened.st_ino == named.st_ino && opened.st_dev == named.st_dev;
}

std::optional<StoreFolder::Mark> StoreFolder::mark() const {
    const auto encoded = readAt(mark_, 0, kMostBytes, path_ / "head");
    const auto content = encoded ? checkedfile::decode(*encoded) : std::nullopt;
    if (!content) return std::nullopt;
    ByteReader in(*content);
    Mark mark;
    mark.revision = in.u64();
    const ByteView hash = in.take(mark.hash.bytes.size());
    if (!in.finished()) return std::nullopt;
    std::ranges::copy(hash, mark.hash.bytes.begin());
    return mark;
}

void StoreFolder::setMark(const Mark& mark) {
    Bytes content;
    appendNumber<Revision>(content, mark.revision);
    appendBytes(content, mark.hash.bytes);
    (void)writeAt(mark_, 0, checkedfile::encode(content), path_ / "head");
}

}  // namespace usdlive::server
