// Removes unused big values.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <vector>

#include "app/SharedStore.h"
#include "app/WorkerLane.h"
#include "project/NamedBlobs.h"
#include "transport/Log.h"

namespace usdlive::server {

/// Removes big values that nothing refers to any more (B6). In each round, workers find the values
/// that the history does not name, the project chooses those that may be removed, and workers
/// remove them. Workers run in small steps, so that nobody waits for them.
///
/// The process may be killed at any point: everything removed was unused, and the next process
/// finds the rest.
class BlobCollector {
public:
    /// Calls Project::unusedBlobs() on the network thread.
    using Choose = std::function<std::vector<Hash>(const std::vector<Hash>& unnamed, Revision upTo,
                                                   std::int64_t nowMs)>;

    /// `keep`: the time before an unused value is removed. The interval of the rounds follows from
    /// it.
    BlobCollector(boost::asio::io_context& network, WorkerShare& workers, SharedStore& store,
                  BlobStore& blobs, std::chrono::milliseconds keep, Log& log);

    // Network thread.
    void start(Choose choose);
    /// Returns the values removed since the start.
    [[nodiscard]] const BlobStore::Purged& removed() const { return removed_; }

private:
    using Clock = std::chrono::steady_clock;

    // Run by workers, one after the other.
    void look();
    void readHistory();
    void purge(BlobStore::Purged removed);
    // Run on the network thread.
    void roundIn(std::chrono::milliseconds pause);
    void choose(const std::vector<Hash>& unnamed, Revision upTo);
    void finished(const BlobStore::Purged& removed);

    template <class Step>
    void onWorker(Step step);
    void finish(const BlobStore::Purged& removed);
    void failed(const Error& error);

    boost::asio::io_context& network_;
    WorkerShare& workers_;
    SharedStore& store_;
    BlobStore& blobs_;
    const std::chrono::milliseconds pause_;
    Log& log_;
    boost::asio::steady_timer timer_;
    Choose choose_;
    BlobStore::Purged removed_;

    // The state of the current round and its workers.
    NamedBlobs named_;
    std::vector<Hash> stored_;
    std::chrono::nanoseconds spent_{};
};

}  // namespace usdlive::server
