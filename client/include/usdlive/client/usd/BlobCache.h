#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <filesystem>
#include <list>
#include <mutex>
#include <thread>
#include <unordered_map>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Hash.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Big values by their hash (V9): for good in files `folder/<hash>`, and in memory while they are
/// new. Files are written by a thread of its own, so that keeping one costs a frame nothing.
///
/// Memory holds at most about `memoryBytes`, the ones used last; more only of what could not be
/// written.
class BlobCache final : public usd::BlobSource, public usd::BlobSink {
public:
    explicit BlobCache(std::filesystem::path folder, std::size_t memoryBytes = 256 * 1024 * 1024);
    /// Waits until what is kept is written.
    ~BlobCache() override;

    [[nodiscard]] SharedBytes blob(const Hash& hash) override;
    void keepBlob(const Hash& hash, SharedBytes bytes) override;
    /// Keeps it in memory only, for as long as there is room.
    void holdBlob(const Hash& hash, SharedBytes bytes);
    /// Is it here, as far as its file's name says?
    [[nodiscard]] bool holds(const Hash& hash);

private:
    enum class State { Held, Unwritten, Written };
    struct Entry {
        SharedBytes bytes;
        State state = State::Held;
        bool queued = false;  ///< in unwritten_, or being written
        std::list<Hash>::iterator use;
    };

    void writeFiles();
    void evict();
    [[nodiscard]] SharedBytes readFile(const Hash& hash) const;
    [[nodiscard]] bool writeFile(const Hash& hash, const Bytes& bytes) const;
    void insert(const Hash& hash, SharedBytes bytes, State state);

    const std::filesystem::path folder_;
    const std::size_t memoryBytes_;

    std::mutex mutex_;  // guards all below
    std::condition_variable changed_;
    std::unordered_map<Hash, Entry> entries_;
    std::list<Hash> uses_;  // the latest first
    std::size_t bytes_ = 0;
    std::deque<Hash> unwritten_;
    bool stopping_ = false;

    std::thread writer_;
};

}  // namespace usdlive::client
