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

#include "usd/ProcessFolder.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Big values by their hash (V9), in memory and in files. Files are written by a thread of its own,
/// so that keeping one costs a frame nothing. Several processes may share a folder.
///
/// `folder/<hash>` is a cache: of more than `folderBytes` the files used longest ago are removed.
/// Values that only this process has (see keepBlob()) are also in a folder of its own, which no
/// other process touches while this one runs.
///
/// Memory holds at most about `memoryBytes`, the ones used last; more only of what could not be
/// written.
class BlobCache final : public usd::BlobSource, public usd::BlobSink {
public:
    static constexpr std::uint64_t kUnbounded = ~std::uint64_t(0);

    explicit BlobCache(std::filesystem::path folder, std::size_t memoryBytes = 256 * 1024 * 1024,
                       std::uint64_t folderBytes = kUnbounded);
    /// Waits until what is kept is written.
    ~BlobCache() override;

    [[nodiscard]] SharedBytes blob(const Hash& hash) override;
    /// Keeps a value that nobody else may have, until keepOnly() does not name it.
    void keepBlob(const Hash& hash, SharedBytes bytes) override;
    /// Caches a value that the server has.
    void cacheBlob(const Hash& hash, SharedBytes bytes);
    /// Holds a value in memory only, for as long as there is room.
    void holdBlob(const Hash& hash, SharedBytes bytes);
    /// Of the values that were kept so far only `named` are kept on. Of the others those that the
    /// server has (`stored`) are cached from now on, and the rest is removed.
    void keepOnly(const std::set<Hash>& named, const std::set<Hash>& stored);
    /// How many are kept.
    [[nodiscard]] std::size_t kept();
    /// Is it here, as far as its file's name says?
    [[nodiscard]] bool holds(const Hash& hash);

private:
    enum class State { Held, Unwritten, Written };
    struct Entry {
        SharedBytes bytes;
        State state = State::Held;
        std::list<Hash>::iterator use;
    };
    static constexpr const char* kOwn = "own-";

    // With mutex_ held.
    void insert(const Hash& hash, SharedBytes bytes, State state);
    void write(const Hash& hash, SharedBytes bytes);
    void evict();

    // By the writer.
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
    std::uint64_t writtenBytes_ = 0;  // since the folder was cleaned; of the writer

    std::mutex mutex_;  // guards all below
    std::condition_variable changed_;
    std::unordered_map<Hash, Entry> entries_;
    std::list<Hash> uses_;  // the latest first
    std::size_t bytes_ = 0;
    std::deque<Hash> unwritten_;
    std::set<Hash> kept_;
    std::set<Hash> cached_, dropped_;  // kept no longer, and still in the own folder
    ProcessFolder own_;                // when there is something to keep; made by the writer
    bool stopping_ = false;

    std::thread writer_;
};

}  // namespace usdlive::client
