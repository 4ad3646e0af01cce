#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "usd/Worker.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Encodes the big arrays of a frame beside it. An array of 200 MB takes a tenth of a second and
/// more to copy and hash, and the editor's frame is not to wait for that: the frame is sealed when
/// a worker has done it, some ticks later.
///
/// As a sink it gives what it has encoded, and passes the bytes of values on. One thread.
class ArrayEncodings final : public usd::BlobSink {
public:
    /// Both outlive this.
    ArrayEncodings(usd::BlobSink& blobs, Worker& worker);

    /// Once encoding was for nothing, as the editor had written the register again meanwhile,
    /// arrays are encoded within the frame for so long.
    static constexpr std::int64_t kAtOnceMs = 1'000;

    /// May the frame be sealed, in which `arrays` were written? The first call with an array begins
    /// to encode it. True also when it is not worth waiting.
    [[nodiscard]] bool areReady(std::vector<pxr::VtValue> arrays, std::int64_t nowMs);
    /// The frame is sealed: nothing is known any more.
    void clear() { job_.reset(); }

    void keepBlob(const Hash& hash, SharedBytes bytes) override;
    [[nodiscard]] std::optional<Value> encoded(const pxr::VtValue& array) override;

private:
    struct Job;

    usd::BlobSink& blobs_;
    Worker& worker_;
    std::shared_ptr<Job> job_;
    std::int64_t atOnceUntil_ = 0;
};

}  // namespace usdlive::client
