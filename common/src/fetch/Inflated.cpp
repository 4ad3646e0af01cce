// Decompresses what arrives from a server, with zstd.
#include "usdlive/common/fetch/Inflated.h"

#include <zstd.h>

namespace usdlive::fetch {

struct Inflated::Stream {
    Stream() : context(ZSTD_createDStream()) {}
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
    ~Stream() { ZSTD_freeDStream(context); }
    ZSTD_DStream* const context;
};

Inflated::Inflated(BodySink& target)
    : target_(target), part_(ZSTD_DStreamInSize()), stream_(std::make_unique<Stream>()) {}
Inflated::~Inflated() = default;

std::string Inflated::add(std::size_t size) {
    ZSTD_inBuffer in{part_.data(), size, 0};
    // The decoder keeps output that does not fit into one part of the target.
    for (bool isFull = false; in.pos < in.size || isFull;) {
        if (isComplete_) return "the compressed content is longer than its frame";
        const std::span<char> space = target_.space();
        ZSTD_outBuffer out{space.data(), space.size(), 0};
        const std::size_t left = ZSTD_decompressStream(stream_->context, &out, &in);
        if (ZSTD_isError(left))
            return std::string("the compressed content is damaged: ") + ZSTD_getErrorName(left);
        inflated_ += out.pos;
        if (inflated_ > kMostBytes) return "the compressed content is too large";
        if (std::string problem = target_.add(out.pos); !problem.empty()) return problem;
        isComplete_ = left == 0;
        isFull = !isComplete_ && out.pos == out.size;
    }
    return {};
}

std::string Inflated::finish() const {
    return isComplete_ ? "" : "the compressed content is not complete";
}

}  // namespace usdlive::fetch
