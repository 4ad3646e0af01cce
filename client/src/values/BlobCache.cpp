// Caches big values in memory and in files.
#include "values/BlobCache.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <optional>
#include <system_error>
#include <vector>

#include "usdlive/common/core/Thread.h"

namespace usdlive::client {

namespace {

namespace fs = std::filesystem;

// Incomplete files of other processes are removed after this time.
constexpr std::chrono::hours kUnfinishedFor{1};

}  // namespace

BlobCache::BlobCache(fs::path folder, std::size_t memoryBytes, std::uint64_t folderBytes)
    : folder_(std::move(folder)),
      memoryBytes_(memoryBytes),
      folderBytes_(folderBytes),
      writer_(startThread("usdlive values", [this] { work(); })) {}

BlobCache::~BlobCache() {
    {
        const std::lock_guard lock(mutex_);
        stopping_ = true;
    }
    changed_.notify_all();
    writer_.join();
}

SharedBytes BlobCache::blob(const Hash& hash) {
    {
        const std::lock_guard lock(mutex_);
        if (const auto found = entries_.find(hash); found != entries_.end()) {
            uses_.splice(uses_.begin(), uses_, found->second.use);
            return found->second.bytes;
        }
    }
    auto bytes = readFile(hash);
    if (!bytes) return nullptr;
    const std::lock_guard lock(mutex_);
    insert(hash, bytes, State::Written);
    return bytes;
}

void BlobCache::keepBlob(const Hash& hash, SharedBytes bytes) {
    const std::lock_guard lock(mutex_);
    if (!bytes) return;
    cached_.erase(hash);
    dropped_.erase(hash);
    if (kept_.insert(hash).second) write(hash, std::move(bytes));
}

void BlobCache::cacheBlob(const Hash& hash, SharedBytes bytes) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(hash);
    if (!bytes || (found != entries_.end() && found->second.state != State::Held)) return;
    write(hash, std::move(bytes));
}

void BlobCache::write(const Hash& hash, SharedBytes bytes) {
    insert(hash, std::move(bytes), State::Unwritten);
    Entry& entry = entries_.at(hash);
    entry.state = State::Unwritten;
    unwritten_.push_back(hash);
    changed_.notify_all();
}

void BlobCache::holdBlob(const Hash& hash, SharedBytes bytes) {
    const std::lock_guard lock(mutex_);
    if (bytes) insert(hash, std::move(bytes), State::Held);
}

void BlobCache::keepOnly(const std::set<Hash>& named, const std::set<Hash>& stored) {
    const std::lock_guard lock(mutex_);
    for (auto kept = kept_.begin(); kept != kept_.end();) {
        if (named.contains(*kept)) {
            ++kept;
            continue;
        }
        // A cached value that is not written yet is then written to the cache folder.
        const bool caches = stored.contains(*kept);
        (caches ? cached_ : dropped_).insert(*kept);
        if (!caches) std::erase(unwritten_, *kept);
        const bool queued = caches && std::ranges::find(unwritten_, *kept) != unwritten_.end();
        const auto entry = entries_.find(*kept);
        if (!queued && entry != entries_.end() && entry->second.state == State::Unwritten)
            entry->second.state = State::Held;
        kept = kept_.erase(kept);
    }
    evict();
    changed_.notify_all();
}

std::size_t BlobCache::kept() {
    const std::lock_guard lock(mutex_);
    return kept_.size();
}

bool BlobCache::holds(const Hash& hash) {
    {
        const std::lock_guard lock(mutex_);
        if (entries_.contains(hash) || kept_.contains(hash)) return true;
    }
    std::error_code error;
    return fs::exists(folder_ / hash.hex(), error);
}

void BlobCache::insert(const Hash& hash, SharedBytes bytes, State state) {
    if (entries_.contains(hash)) return;
    bytes_ += bytes->size();
    uses_.push_front(hash);
    entries_[hash] = {std::move(bytes), state, uses_.begin()};
    evict();
}

void BlobCache::evict() {
    auto use = uses_.end();
    while (bytes_ > memoryBytes_ && use != uses_.begin()) {
        --use;
        const auto entry = entries_.find(*use);
        if (entry->second.state == State::Unwritten) continue;
        bytes_ -= entry->second.bytes->size();
        entries_.erase(entry);
        use = uses_.erase(use);
    }
}

// ---- the writer

void BlobCache::work() {
    if (folderBytes_ != kUnbounded) {
        ProcessFolder::removeDead(folder_, kOwn);
        clean();
    }
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] {
            return stopping_ || !unwritten_.empty() || !cached_.empty() || !dropped_.empty();
        });
        if (!cached_.empty() || !dropped_.empty()) {
            const auto cached = std::exchange(cached_, {}), dropped = std::exchange(dropped_, {});
            lock.unlock();
            workOff(cached, dropped);
            lock.lock();
            continue;
        }
        if (unwritten_.empty()) return;
        const Hash hash = unwritten_.front();
        unwritten_.pop_front();
        const SharedBytes bytes = entries_.at(hash).bytes;  // not evicted before it is written
        const bool kept = kept_.contains(hash);
        lock.unlock();
        const bool written = writeFile(hash, *bytes, kept);
        lock.lock();
        // The value may have been queued again, to be kept by now.
        const bool again = std::ranges::find(unwritten_, hash) != unwritten_.end();
        const auto entry = entries_.find(hash);  // it may have been dropped meanwhile
        const bool waits = entry != entries_.end() && entry->second.state == State::Unwritten;
        if (written && !again && waits) entry->second.state = State::Written;
        // The disk may be full. Values that others have need not stay in memory.
        if (!written && !again && waits && !kept_.contains(hash)) entry->second.state = State::Held;
        evict();
    }
}

void BlobCache::workOff(const std::set<Hash>& cached, const std::set<Hash>& dropped) {
    if (!own_) return;
    std::error_code ignored;
    for (const Hash& hash : dropped) fs::remove(own_.path() / hash.hex(), ignored);
    for (const Hash& hash : cached)
        fs::rename(own_.path() / hash.hex(), folder_ / hash.hex(), ignored);
}

bool BlobCache::writeFile(const Hash& hash, const Bytes& bytes, bool kept) {
    std::error_code error;
    const fs::path shared = folder_ / hash.hex();
    fs::create_directories(folder_, error);
    if (kept && !makeOwnFolder()) return false;
    if (!kept && fs::file_size(shared, error) == bytes.size() && !error) return true;
    const fs::path target = kept ? own_.path() / hash.hex() : shared;
    const fs::path unfinished = folder_ / (unusedName() + ".part");
    {
        std::ofstream file(unfinished, std::ios::binary | std::ios::trunc);
        file.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
        if (!file.flush()) {
            fs::remove(unfinished, error);
            return false;
        }
    }
    fs::rename(unfinished, target, error);
    if (error) return false;
    writtenBytes_ += bytes.size();
    if (folderBytes_ != kUnbounded && writtenBytes_ > folderBytes_ / 16) clean();
    return true;
}

bool BlobCache::makeOwnFolder() {
    if (own_) return true;
    auto made = ProcessFolder::make(folder_, kOwn);
    const std::lock_guard lock(mutex_);
    own_ = std::move(made);
    return bool(own_);
}

// Removes the least recently used files.
void BlobCache::clean() {
    struct File {
        fs::file_time_type used;
        std::uint64_t bytes;
        fs::path path;
    };
    writtenBytes_ = 0;
    std::vector<File> files;
    std::uint64_t all = 0;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder_, error)) {
        std::error_code gone;  // another process may have removed it
        const File file{entry.last_write_time(gone), entry.file_size(gone), entry.path()};
        if (gone) continue;
        const auto age = fs::file_time_type::clock::now() - file.used;
        if (file.path.extension() == ".part" && age > kUnfinishedFor) fs::remove(file.path, gone);
        if (!hashFromHex(file.path.filename().string())) continue;
        all += file.bytes;
        files.push_back(file);
    }
    if (all <= folderBytes_) return;
    std::ranges::sort(files, {}, &File::used);
    for (const File& file : files) {
        if (all <= folderBytes_ / 4 * 3) return;
        all -= file.bytes;
        fs::remove(file.path, error);
    }
}

SharedBytes BlobCache::readFile(const Hash& hash) {
    fs::path own;
    {
        const std::lock_guard lock(mutex_);
        if (kept_.contains(hash) && own_) own = own_.path() / hash.hex();
    }
    SharedBytes bytes = own.empty() ? nullptr : readFile(own, hash);
    return bytes ? bytes : readFile(folder_ / hash.hex(), hash);
}

// Verifies the content, because an earlier run may have written an incomplete file.
SharedBytes BlobCache::readFile(const fs::path& path, const Hash& hash) {
    std::error_code error;
    const auto size = fs::file_size(path, error);
    if (error) return nullptr;
    Bytes bytes(size);
    std::ifstream file(path, std::ios::binary);
    if (!file.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(size))) return nullptr;
    if (sha256(ByteView(bytes)) != hash) {
        fs::remove(path, error);
        return nullptr;
    }
    fs::last_write_time(path, fs::file_time_type::clock::now(), error);  // notes the use
    return std::make_shared<const Bytes>(std::move(bytes));
}

}  // namespace usdlive::client
