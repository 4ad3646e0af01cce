// Stores big values as files.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <unordered_set>
#include <utility>

#include "storage/BlobRules.h"
#include "storage/BlobStore.h"
#include "storage/Files.h"
#include "storage/FreeSpace.h"
#include "usdlive/common/core/Budget.h"
#include "usdlive/common/core/Sha256.h"

namespace usdlive::server {

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kPlentyBytes = std::uint64_t(4) << 30;

/// A value that is being written. Deletes its file unless keep() was called.
class Unfinished {
public:
    static Result<Unfinished> begin(fs::path path) {
        auto file = openFile(path, O_RDWR | O_CREAT | O_TRUNC);
        if (!file) return tl::unexpected(file.error());
        return Unfinished(std::move(*file), std::move(path));
    }
    Unfinished(Unfinished&& other) noexcept
        : file_(std::move(other.file_)),
          path_(std::exchange(other.path_, {})),
          hash_(std::move(other.hash_)),
          written_(other.written_) {}
    Unfinished& operator=(Unfinished&&) = delete;
    ~Unfinished() {
        if (!path_.empty()) ::unlink(path_.c_str());
    }

    [[nodiscard]] std::uint64_t written() const { return written_; }

    Result<void> add(ByteView part) {
        hash_.add(part);
        const auto added = writeAt(file_, written_, part, path_);
        written_ += part.size();
        return added;
    }
    [[nodiscard]] Hash finish() { return hash_.finish(); }

    Result<void> sync() { return syncFile(file_, path_); }
    Result<void> rename(const fs::path& name) {
        if (::rename(path_.c_str(), name.c_str()) != 0)
            return tl::unexpected(systemError("rename to", name));
        path_.clear();
        return {};
    }

private:
    Unfinished(Descriptor file, fs::path path) : file_(std::move(file)), path_(std::move(path)) {}

    Descriptor file_;
    fs::path path_;  // empty: the file was moved away
    Sha256 hash_;
    std::uint64_t written_ = 0;
};

class FileBlobStore final : public BlobStore {
public:
    FileBlobStore(fs::path folder, const BlobStoreOptions& options)
        : folder_(std::move(folder)), options_(options) {}

    Result<void> open() {
        std::error_code ignored;
        fs::remove_all(unfinished(), ignored);
        return makeFolders(unfinished());
    }

    [[nodiscard]] bool has(const Hash& hash) const override {
        return ::access(name(hash).c_str(), F_OK) == 0 && !isDropped(hash);
    }
    [[nodiscard]] Result<std::uint64_t> size(const Hash& hash) const override;
    Result<bool> write(const Hash& hash, std::uint64_t size, std::uint64_t offset, ByteView part,
                       const BlobWriter& writer) override;
    [[nodiscard]] Result<Bytes> read(const Hash& hash, std::uint64_t offset,
                                     std::size_t count) const override;
    void forget(std::uint64_t writer) override;
    [[nodiscard]] Result<std::vector<Hash>> list() const override;
    void drop(std::span<const Hash> hashes) override;
    Result<Purged> purge(std::size_t most) override;

private:
    using Clock = std::chrono::steady_clock;
    using Upload = std::pair<Hash, std::uint64_t>;  // and its writer
    struct Entry {
        Unfinished value;
        std::string share;                                  // that of its writer
        std::uint64_t turn;                                 // number of its last part
        Clock::time_point left = Clock::time_point::max();  // when its writer left
    };
    using Entries = std::map<Upload, Entry>;
    static bool isLeft(const Entries::value_type& entry) {
        return entry.second.left != Clock::time_point::max();
    }

    [[nodiscard]] fs::path unfinished() const { return folder_ / "unfinished"; }
    [[nodiscard]] fs::path name(const Hash& hash) const {
        const std::string hex = hash.hex();
        return folder_ / hex.substr(0, 2) / hex;
    }
    [[nodiscard]] bool isDropped(const Hash& hash) const {
        const std::lock_guard lock(mutex_);
        return dropped_.contains(hash);
    }
    [[nodiscard]] Result<void> checkSpace(std::uint64_t bytes) const;
    [[nodiscard]] bool hasPlenty() const;
    [[nodiscard]] Result<void> makeSpace(std::uint64_t bytes);
    using Condition = std::function<bool(const Entries::value_type&)>;
    Entries takeIf(const Condition& condition);
    Entries::iterator oldest(const Condition& condition);
    void bound(const Upload& added);
    Entries::iterator leftOf(const Hash& hash);
    void boundLeft();
    [[nodiscard]] Result<Descriptor> openValue(const Hash& hash) const;
    Result<Unfinished> take(const Upload& upload, std::uint64_t offset);
    void putBack(const Upload& upload, Unfinished value, const std::string& share);
    Result<void> keep(const Hash& hash, Unfinished& value);

    const fs::path folder_;
    const BlobStoreOptions options_;

    // Guards the next three members. Not held while a file is written or removed, except when a
    // file replaces or removes a dropped value, so that the two do not interfere.
    mutable std::mutex mutex_;
    Entries unfinished_;
    std::uint64_t turn_ = 0;
    std::unordered_set<Hash> dropped_;
};

Result<void> FileBlobStore::checkSpace(std::uint64_t bytes) const {
    const DiskSpace disk = diskSpace(folder_);
    if (disk.free >= minFree(options_.minFreeBytes, disk) + bytes) return {};
    return fail(ErrorCode::StorageFull, "the disk of " + folder_.string() + " is full");
}

/// Returns whether so much is free that the store of commits, which needs more than checkSpace()
/// does, is not full either.
bool FileBlobStore::hasPlenty() const {
    const DiskSpace disk = diskSpace(folder_);
    return disk.free >=
           2 * minFree(options_.minFreeBytes, disk) + std::min(disk.total / 10, kPlentyBytes);
}

/// Removes what perhaps nobody continues, if there is no space otherwise.
Result<void> FileBlobStore::makeSpace(std::uint64_t bytes) {
    if (checkSpace(bytes)) return {};
    takeIf(isLeft);
    return checkSpace(bytes);
}

Result<Descriptor> FileBlobStore::openValue(const Hash& hash) const {
    if (!has(hash))
        return blobError(ErrorCode::BlobNotFound, hash, "is not in " + folder_.string());
    return openFile(name(hash), O_RDONLY);
}

Result<std::uint64_t> FileBlobStore::size(const Hash& hash) const {
    const auto file = openValue(hash);
    if (!file) return tl::unexpected(file.error());
    struct stat status{};
    if (::fstat(file->get(), &status) != 0)
        return tl::unexpected(systemError("ask for the size of", name(hash)));
    return std::uint64_t(status.st_size);
}

Result<Bytes> FileBlobStore::read(const Hash& hash, std::uint64_t offset, std::size_t count) const {
    const auto length = size(hash);
    if (!length) return tl::unexpected(length.error());
    const auto file = openValue(hash);
    if (!file) return tl::unexpected(file.error());
    // `count` comes from a client: allocates no more than the file has.
    const std::uint64_t there = *length - std::min(offset, *length);
    return readAt(*file, offset, std::size_t(std::min<std::uint64_t>(count, there)), name(hash));
}

Result<bool> FileBlobStore::write(const Hash& hash, std::uint64_t size, std::uint64_t offset,
                                  ByteView part, const BlobWriter& writer) {
    const Upload upload(hash, writer.id);
    if (has(hash)) {  // another writer may have been faster
        const std::lock_guard lock(mutex_);
        unfinished_.erase(upload);
        return true;
    }
    auto value = take(upload, offset);
    if (!value) return tl::unexpected(value.error());
    offset = skipWritten(value->written(), offset, part);
    const auto added =
        checkPart(hash, size, value->written(), offset, part.size(), options_.maxBytes)
            .and_then([&] { return makeSpace(part.size()); })
            .and_then([&] { return value->add(part); });
    if (!added) return tl::unexpected(added.error());
    if (value->written() < size) {
        putBack(upload, std::move(*value), writer.share);
        return false;
    }
    return keep(hash, *value).map([] { return true; });
}

/// Takes the unfinished value out of the table, so that it is dropped if anything fails.
Result<Unfinished> FileBlobStore::take(const Upload& upload, std::uint64_t offset) {
    const auto& [hash, writer] = upload;
    {
        const std::lock_guard lock(mutex_);
        auto entry = unfinished_.extract(upload);
        if (entry.empty() && offset > 0)
            if (const auto left = leftOf(hash); left != unfinished_.end())
                entry = unfinished_.extract(left);
        if (!entry.empty() && offset > 0) return std::move(entry.mapped().value);
    }
    if (offset > 0)
        return blobError(ErrorCode::BlobMismatch, hash, "continues a value that was not started");
    return Unfinished::begin(unfinished() / (hash.hex() + "-" + std::to_string(writer)));
}

void FileBlobStore::putBack(const Upload& upload, Unfinished value, const std::string& share) {
    const std::lock_guard lock(mutex_);
    unfinished_.emplace(upload, Entry{std::move(value), share, ++turn_});
    bound(upload);
}

Result<void> FileBlobStore::keep(const Hash& hash, Unfinished& value) {
    const Hash actual = value.finish();
    if (actual != hash)
        return blobError(ErrorCode::BlobMismatch, hash, "has the content of " + actual.hex());
    const fs::path path = name(hash);
    const auto rename = [&] {
        const std::lock_guard lock(mutex_);
        return value.rename(path).map([&] { dropped_.erase(hash); });
    };
    return makeFolders(path.parent_path())
        .and_then([&] { return value.sync(); })
        .and_then(rename)
        .and_then([&] { return syncFolder(path.parent_path()); });
}

/// TL2: keeps what has arrived, in bounds. Nothing keeps a full disk full.
void FileBlobStore::forget(std::uint64_t writer) {
    const Clock::time_point now = Clock::now();
    {
        const std::lock_guard lock(mutex_);
        for (auto& entry : unfinished_)
            if (entry.first.second == writer && !isLeft(entry)) entry.second.left = now;
        boundLeft();
    }
    const bool isPlenty = hasPlenty();
    takeIf([&](const auto& entry) {
        return isLeft(entry) && (!isPlenty || entry.second.left <= now - options_.keepLeft);
    });
}

/// SE22: drops a value if there are too many: one that was left, otherwise one of the writer with
/// the most, in the share with the most. The caller holds the mutex, also of the next three.
void FileBlobStore::bound(const Upload& added) {
    Budget<std::uint64_t> values({.all = options_.maxUnfinished});  // by writer
    for (const auto& entry : unfinished_) values.take(entry.first.second, 1, entry.second.share);
    const auto most = values.givesWay(added.second);
    if (!most) return;
    const auto left = oldest(isLeft);
    unfinished_.erase(left != unfinished_.end() ? left : oldest([&](const auto& entry) {
        return entry.first.second == *most;
    }));
}

void FileBlobStore::boundLeft() {
    std::uint64_t bytes = 0;
    for (const auto& entry : unfinished_)
        if (isLeft(entry)) bytes += entry.second.value.written();
    while (bytes > options_.maxLeftBytes) {
        const auto first = oldest(isLeft);
        bytes -= first->second.value.written();
        unfinished_.erase(first);
    }
}

/// Returns the value whose last part is the oldest, of those that satisfy the condition.
FileBlobStore::Entries::iterator FileBlobStore::oldest(const Condition& condition) {
    auto oldest = unfinished_.end();
    for (auto entry = unfinished_.begin(); entry != unfinished_.end(); ++entry)
        if (condition(*entry) &&
            (oldest == unfinished_.end() || entry->second.turn < oldest->second.turn))
            oldest = entry;
    return oldest;
}

/// Returns the upload of the value that has come furthest, of writers that have left.
FileBlobStore::Entries::iterator FileBlobStore::leftOf(const Hash& hash) {
    auto furthest = unfinished_.end();
    for (auto entry = unfinished_.lower_bound({hash, 0});
         entry != unfinished_.end() && entry->first.first == hash; ++entry)
        if (isLeft(*entry) && (furthest == unfinished_.end() ||
                               entry->second.value.written() > furthest->second.value.written()))
            furthest = entry;
    return furthest;
}

/// Files are removed when the result is destroyed, without the lock.
FileBlobStore::Entries FileBlobStore::takeIf(const Condition& condition) {
    Entries taken;
    const std::lock_guard lock(mutex_);
    for (auto one = unfinished_.begin(); one != unfinished_.end();) {
        const auto next = std::next(one);
        if (condition(*one)) taken.insert(unfinished_.extract(one));
        one = next;
    }
    return taken;
}

Result<std::vector<Hash>> FileBlobStore::list() const {
    std::vector<Hash> all;
    std::error_code error;
    for (const auto& folder : fs::directory_iterator(folder_, error)) {
        std::error_code none;
        for (const auto& file : fs::directory_iterator(folder.path(), none))
            if (const auto hash = hashFromHex(file.path().filename().string());
                hash && !isDropped(*hash))
                all.push_back(*hash);
    }
    if (error)
        return fail(ErrorCode::StorageFailed,
                    "cannot list " + folder_.string() + ": " + error.message());
    return all;
}

void FileBlobStore::drop(std::span<const Hash> hashes) {
    const std::lock_guard lock(mutex_);
    dropped_.insert(hashes.begin(), hashes.end());
}

Result<BlobStore::Purged> FileBlobStore::purge(std::size_t most) {
    Purged purged;
    const fs::path going = unfinished() / "dropped";
    while (purged.values < most) {
        {
            const std::lock_guard lock(mutex_);
            if (dropped_.empty()) break;
            const fs::path path = name(*dropped_.begin());
            if (::rename(path.c_str(), going.c_str()) != 0 && errno != ENOENT)
                return tl::unexpected(systemError("remove", path));
            dropped_.erase(dropped_.begin());
        }
        ++purged.values;
        struct stat status{};
        if (::stat(going.c_str(), &status) == 0) purged.bytes += std::uint64_t(status.st_size);
        ::unlink(going.c_str());
    }
    return purged;
}

}  // namespace

Result<std::unique_ptr<BlobStore>> createFileBlobStore(const std::filesystem::path& folder,
                                                       const BlobStoreOptions& options) {
    auto store = std::make_unique<FileBlobStore>(folder, options);
    if (const auto opened = store->open(); !opened) return tl::unexpected(opened.error());
    return store;
}

}  // namespace usdlive::server
