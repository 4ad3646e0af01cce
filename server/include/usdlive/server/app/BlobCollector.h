#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <vector>

#include "usdlive/server/app/SharedStore.h"
#include "usdlive/server/project/NamedBlobs.h"
#include "usdlive/server/transport/Log.h"

namespace usdlive::server {

/// Removes big values that nothing names any more (B6), round by round: workers look which values
/// the history does not name, the project says which of them may go, workers remove these. Workers
/// are given small steps, so that nobody waits for it.
///
/// It may be killed at any point: what is removed nothing names, and what is left the next process
/// finds again.
class BlobCollector {
public:
    /// Project::unusedBlobs(); called on the network thread.
    using Choose = std::function<std::vector<Hash>(const std::vector<Hash>& unnamed, Revision upTo,
                                                   std::int64_t nowMs)>;

    /// `keep`: for how long a value is kept that nothing names. The rounds follow from it.
    BlobCollector(boost::asio::io_context& network, boost::asio::thread_pool& workers,
                  SharedStore& store, BlobStore& blobs, std::chrono::milliseconds keep, Log& log);

    // Network thread.
    void start(Choose choose);
    /// All that were removed since the start.
    [[nodiscard]] const BlobStore::Purged& removed() const { return removed_; }

private:
    using Clock = std::chrono::steady_clock;

    // By workers, one after the other.
    void look();
    void readHistory();
    void purge(BlobStore::Purged removed);
    // By the network thread.
    void roundIn(std::chrono::milliseconds pause);
    void choose(const std::vector<Hash>& unnamed, Revision upTo);
    void finished(const BlobStore::Purged& removed);

    template <class Step>
    void onWorker(Step step);
    void finish(const BlobStore::Purged& removed);
    void failed(const Error& error);

    boost::asio::io_context& network_;
    boost::asio::thread_pool& workers_;
    SharedStore& store_;
    BlobStore& blobs_;
    const std::chrono::milliseconds pause_;
    Log& log_;
    boost::asio::steady_timer timer_;
    Choose choose_;
    BlobStore::Purged removed_;

    // Of the round, and of its workers.
    NamedBlobs named_;
    std::vector<Hash> stored_;
    std::chrono::nanoseconds spent_{};
};

}  // namespace usdlive::server
