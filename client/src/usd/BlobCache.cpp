#include "usdlive/client/usd/BlobCache.h"

#include <fstream>
#include <optional>
#include <system_error>

namespace usdlive::client {

BlobCache::BlobCache(std::filesystem::path folder, std::size_t memoryBytes)
    : folder_(std::move(folder)), memoryBytes_(memoryBytes), writer_([this] { writeFiles(); }) {}

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
    insert(hash, std::move(bytes), State::Unwritten);
    Entry& entry = entries_.at(hash);
    if (entry.state == State::Written || entry.queued) return;
    entry.state = State::Unwritten;
    entry.queued = true;
    unwritten_.push_back(hash);
    changed_.notify_all();
}

void BlobCache::holdBlob(const Hash& hash, SharedBytes bytes) {
    const std::lock_guard lock(mutex_);
    if (bytes) insert(hash, std::move(bytes), State::Held);
}

bool BlobCache::holds(const Hash& hash) {
    {
        const std::lock_guard lock(mutex_);
        if (entries_.contains(hash)) return true;
    }
    std::error_code error;
    return std::filesystem::exists(folder_ / hash.hex(), error);
}

void BlobCache::insert(const Hash& hash, SharedBytes bytes, State state) {
    if (entries_.contains(hash)) return;
    bytes_ += bytes->size();
    uses_.push_front(hash);
    entries_[hash] = {std::move(bytes), state, false, uses_.begin()};
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

void BlobCache::writeFiles() {
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return stopping_ || !unwritten_.empty(); });
        if (unwritten_.empty()) return;
        const Hash hash = unwritten_.front();
        unwritten_.pop_front();
        const SharedBytes bytes = entries_.at(hash).bytes;  // not evicted before it is written
        lock.unlock();
        const bool written = writeFile(hash, *bytes);
        lock.lock();
        Entry& entry = entries_.at(hash);
        entry.queued = false;
        if (written) entry.state = State::Written;
        evict();
    }
}

bool BlobCache::writeFile(const Hash& hash, const Bytes& bytes) const {
    std::error_code error;
    const auto path = folder_ / hash.hex();
    if (std::filesystem::file_size(path, error) == bytes.size() && !error) return true;
    std::filesystem::create_directories(folder_, error);
    auto unfinished = path;
    unfinished += ".part";
    {
        std::ofstream file(unfinished, std::ios::binary | std::ios::trunc);
        file.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
        if (!file.flush()) {
            std::filesystem::remove(unfinished, error);
            return false;
        }
    }
    std::filesystem::rename(unfinished, path, error);
    return !error;
}

// The file may be of an earlier run, or of a full disk: what its bytes are is what counts.
SharedBytes BlobCache::readFile(const Hash& hash) const {
    std::error_code error;
    const auto path = folder_ / hash.hex();
    const auto size = std::filesystem::file_size(path, error);
    if (error) return nullptr;
    Bytes bytes(size);
    std::ifstream file(path, std::ios::binary);
    if (!file.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(size))) return nullptr;
    if (sha256(ByteView(bytes)) != hash) {
        std::filesystem::remove(path, error);
        return nullptr;
    }
    return std::make_shared<const Bytes>(std::move(bytes));
}

}  // namespace usdlive::client
