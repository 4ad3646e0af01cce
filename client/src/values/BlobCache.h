// A cache of big values in memory and in files.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <list>
#include <mutex>
#include <set>
#include <thread>
#include <unordered_map>

#include "basics/ProcessFolder.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/layer/Blobs.h"

namespace usdlive::client {

/// A cache of big values by their hash (V9), in memory and in files. A separate thread writes the
/// files, so that they do not delay a frame. Several processes may share a folder.
///
/// `folder/<hash>` is a cache: if it exceeds `folderBytes`, the least recently used files are
/// removed. Values that only this process has (see keepBlob()) are also in a folder of its own,
/// which no other process changes while this one runs.
///
/// The most recently used values stay in memory, about `memoryBytes`. Values that could not be
/// written stay in addition.
class BlobCache final : public BlobSource, public BlobSink {
public:
    static constexpr std::uint64_t kUnbounded = ~std::uint64_t(0);

    explicit BlobCache(std::filesystem::path folder, std::size_t memoryBytes = 256 * 1024 * 1024,
                       std::uint64_t folderBytes = kUnbounded);
    /// Waits until all kept values are written.
    ~BlobCache() override;

    [[nodiscard]] SharedBytes blob(const Hash& hash) override;
    /// Keeps a value that others may not have, until a keepOnly() that does not name it.
    void keepBlob(const Hash& hash, SharedBytes bytes) override;
    /// Caches a value that the server has, too.
    void cacheBlob(const Hash& hash, SharedBytes bytes);
    /// Holds a value in memory only, as long as there is space.
    void holdBlob(const Hash& hash, SharedBytes bytes);
    /// Stops keeping all values except `named`. The others are cached from now on if the server has
    /// them (`stored`), and removed otherwise.
    void keepOnly(const std::set<Hash>& named, const std::set<Hash>& stored);
    /// Returns the number of kept values.
    [[nodiscard]] std::size_t kept();
    /// Returns whether the value is in memory or there is a file with its name.
    [[nodiscard]] bool holds(const Hash& hash);

private:
    enum class State { Held, Unwritten, Written };
    struct Entry {
        SharedBytes bytes;
        State state = State::Held;
        std::list<Hash>::iterator use;
    };
    static constexpr const char* kOwn = "own-";

    // The caller holds mutex_.
    void insert(const Hash& hash, SharedBytes bytes, State state);
    void write(const Hash& hash, SharedBytes bytes);
    void evict();

    // Called by the writer's thread.
    void work();
    void workOff(const std::set<Hash>& cached, const std::set<Hash>& dropped);
    [[nodiscard]] bool writeFile(const Hash& hash, const Bytes& bytes, bool kept);
    [[nodiscard]] bool makeOwnFolder();
    void clean();

    [[nodiscard]] SharedBytes readFile(const Hash& hash);
    [[nodiscard]] static SharedBytes readFile(const std::filesystem::path& path, const Hash& hash);

    const std::filesystem::path folder_;
    const std::size_t memoryBytes_;
    const std::uint64_t folderBytes_;
    std::uint64_t writtenBytes_ = 0;  // bytes since the last clean(); used by the writer only

    std::mutex mutex_;  // guards all members below
    std::condition_variable changed_;
    std::unordered_map<Hash, Entry> entries_;
    std::list<Hash> uses_;  // most recently used first
    std::size_t bytes_ = 0;
    std::deque<Hash> unwritten_;
    std::set<Hash> kept_;
    std::set<Hash> cached_, dropped_;  // no longer kept, but still in the own folder
    ProcessFolder own_;                // created by the writer when it is first needed
    bool stopping_ = false;

    std::thread writer_;
};

}  // namespace usdlive::client
