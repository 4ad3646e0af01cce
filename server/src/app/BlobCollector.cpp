// Removes unused big values in rounds.
#include "app/BlobCollector.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <utility>

namespace usdlive::server {

namespace asio = boost::asio;

namespace {

using std::chrono::milliseconds;

// The limits of the pause between rounds, and the share of time that they may take.
constexpr milliseconds kLeastPause{500}, kMostPause{60'000};
constexpr int kRoundsWhileKept = 4, kWorkPart = 20;
// A step takes a few milliseconds.
constexpr std::size_t kStepBytes = 4 * 1024 * 1024;
constexpr std::size_t kStepValues = 64;

}  // namespace

BlobCollector::BlobCollector(asio::io_context& network, WorkerShare& workers, SharedStore& store,
                             BlobStore& blobs, milliseconds keep, Log& log)
    : network_(network),
      workers_(workers),
      store_(store),
      blobs_(blobs),
      pause_(std::clamp(keep / kRoundsWhileKept, kLeastPause, kMostPause)),
      log_(log),
      timer_(network) {}

void BlobCollector::start(Choose choose) {
    choose_ = std::move(choose);
    roundIn(pause_);
}

void BlobCollector::roundIn(milliseconds pause) {
    timer_.expires_after(pause);
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (!error) onWorker([this] { look(); });
    });
}

template <class Step>
void BlobCollector::onWorker(Step step) {
    workers_.post([this, step = std::move(step)] {
        const auto begin = Clock::now();
        step();
        spent_ += Clock::now() - begin;
    });
}

// Lists the values before it reads the history: the project knows of all references added later.
void BlobCollector::look() {
    spent_ = {};
    blobs_.forget({});  // incomplete values that nobody has continued for too long
    auto stored = blobs_.list();
    if (!stored) return failed(stored.error());
    stored_ = std::move(*stored);
    if (stored_.empty()) return finish({});
    onWorker([this] { readHistory(); });
}

void BlobCollector::readHistory() {
    const auto read =
        store_.use([this](CommitStore& store) { return named_.read(store, kStepBytes); });
    if (!read) return failed(read.error());
    if (!*read) return onWorker([this] { readHistory(); });
    std::erase_if(stored_, [this](const Hash& hash) { return named_.contains(hash); });
    asio::post(network_, [this, unnamed = std::exchange(stored_, {}), upTo = named_.upTo()] {
        choose(unnamed, upTo);
    });
}

void BlobCollector::choose(const std::vector<Hash>& unnamed, Revision upTo) {
    const auto now = std::chrono::duration_cast<milliseconds>(Clock::now().time_since_epoch());
    const std::vector<Hash> unused = choose_(unnamed, upTo, now.count());
    if (unused.empty()) return finished({});
    blobs_.drop(unused);
    onWorker([this] { purge({}); });
}

void BlobCollector::purge(BlobStore::Purged removed) {
    const auto some = blobs_.purge(kStepValues);
    if (!some) return failed(some.error());
    removed.values += some->values;
    removed.bytes += some->bytes;
    if (some->values < kStepValues) return finish(removed);
    onWorker([this, removed] { purge(removed); });
}

void BlobCollector::failed(const Error& error) {
    // The failure of a store is reported elsewhere.
    if (error.code != ErrorCode::StorageFailed)
        log_.write(LogLevel::Warning, "unused big values are not removed",
                   {{"error", error.message}});
    finish({});
}

void BlobCollector::finish(const BlobStore::Purged& removed) {
    asio::post(network_, [this, removed] { finished(removed); });
}

void BlobCollector::finished(const BlobStore::Purged& removed) {
    removed_.values += removed.values;
    removed_.bytes += removed.bytes;
    if (removed.values > 0)
        log_.write(LogLevel::Info, "unused big values removed",
                   {{"values", removed.values}, {"bytes", removed.bytes}});
    roundIn(std::max(pause_, std::chrono::duration_cast<milliseconds>(spent_) * kWorkPart));
}

}  // namespace usdlive::server
