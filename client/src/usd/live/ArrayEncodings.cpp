// Encodes and hashes the editor's big arrays by a worker before their frame is sealed.
#include "usd/live/ArrayEncodings.h"

#include <algorithm>
#include <atomic>
#include <utility>

namespace usdlive::client {

// The worker writes `encoded` and `bytes`. They are read only when `done` is true.
struct ArrayEncodings::Job final : public BlobSink {
    explicit Job(std::vector<pxr::VtValue> written) : arrays(std::move(written)) {}

    void run() {
        for (const pxr::VtValue& array : arrays) {
            auto value = usd::encodeLeaf(array, *this);
            encodings.push_back(value ? std::optional(*std::move(value)) : std::nullopt);
        }
        done = true;
    }
    void keepBlob(const Hash& hash, SharedBytes bytes) override {
        kept.emplace_back(hash, std::move(bytes));
    }

    const std::vector<pxr::VtValue> arrays;
    std::atomic<bool> done = false;
    // One for each array; nothing: it cannot be encoded.
    std::vector<std::optional<Value>> encodings;
    std::vector<std::pair<Hash, SharedBytes>> kept;
};

ArrayEncodings::ArrayEncodings(BlobSink& blobs, Worker& worker) : blobs_(blobs), worker_(worker) {}

bool ArrayEncodings::areReady(std::vector<pxr::VtValue> arrays, std::int64_t nowMs) {
    if (arrays.empty() || nowMs < atOnceUntil_) return true;
    if (!job_) {
        job_ = std::make_shared<Job>(std::move(arrays));
        worker_.post([job = job_] { job->run(); });
        return false;
    }
    if (!job_->done) return false;
    if (job_->arrays != arrays) atOnceUntil_ = nowMs + kAtOnceMs;
    return true;
}

void ArrayEncodings::keepBlob(const Hash& hash, SharedBytes bytes) {
    blobs_.keepBlob(hash, std::move(bytes));
}

std::optional<Value> ArrayEncodings::encoded(const pxr::VtValue& array) {
    if (!job_ || !job_->done) return std::nullopt;
    const auto found = std::ranges::find(job_->arrays, array);
    if (found == job_->arrays.end()) return std::nullopt;
    const auto& value = job_->encodings[std::size_t(found - job_->arrays.begin())];
    if (value && value->isBlob())
        for (const auto& [hash, bytes] : job_->kept)
            if (hash == value->hash()) blobs_.keepBlob(hash, bytes);
    return value;
}

}  // namespace usdlive::client
