// Encodes the editor's big arrays by a worker.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "basics/Worker.h"
#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::client {

/// Encodes the big arrays of a frame by a worker. Copying and hashing an array of 200 MB takes more
/// than a tenth of a second, which must not delay the editor's frame. The frame is sealed some
/// ticks later, when the worker has finished.
///
/// The sink returns encoded arrays, and forwards the bytes of values. Used by one thread.
class ArrayEncodings final : public BlobSink, private usd::EncodedArrays {
public:
    /// Both arguments outlive this object.
    ArrayEncodings(BlobSink& blobs, Worker& worker);

    /// If an encoding was useless because the editor wrote the register again meanwhile, arrays are
    /// encoded within the frame for this time.
    static constexpr std::int64_t kAtOnceMs = 1'000;

    /// Returns whether the frame in which `arrays` were written may be sealed: all are encoded, or
    /// waiting is not worthwhile. The first call with an array starts to encode it.
    [[nodiscard]] bool areReady(std::vector<pxr::VtValue> arrays, std::int64_t nowMs);
    /// Drops all results. Call it when the frame was sealed.
    void clear() { job_.reset(); }

    void keepBlob(const Hash& hash, SharedBytes bytes) override;
    [[nodiscard]] usd::EncodedArrays* encodedArrays() override { return this; }

private:
    [[nodiscard]] std::optional<Value> encoded(const pxr::VtValue& array) override;

    struct Job;

    BlobSink& blobs_;
    Worker& worker_;
    std::shared_ptr<Job> job_;
    std::int64_t atOnceUntil_ = 0;
};

}  // namespace usdlive::client
