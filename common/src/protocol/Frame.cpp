// Messages to frames, compression, chain hashes.
#include "usdlive/common/protocol/Frame.h"

#include <zstd.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

namespace {

// A context is large: creating one takes longer than most compressions with it.
struct FreeContext {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};
thread_local const std::unique_ptr<ZSTD_CCtx, FreeContext> compressor(ZSTD_createCCtx());
thread_local const std::unique_ptr<ZSTD_DCtx, FreeContext> decompressor(ZSTD_createDCtx());

}  // namespace

Result<std::vector<ByteView>> splitMessage(ByteView message, std::size_t maxFrameBytes) {
    std::vector<ByteView> frames;
    ByteReader reader(message);
    while (reader.left() != 0) {
        const std::uint32_t length = reader.u32();
        if (!reader.failed() && length > maxFrameBytes)
            return fail(ErrorCode::FrameTooLarge,
                        "a frame of " + std::to_string(length) + " bytes; at most " +
                            std::to_string(maxFrameBytes) + " are accepted");
        const ByteView frame = reader.take(length);
        if (reader.failed())
            return fail(ErrorCode::MalformedFrame, "a message ends within a frame");
        if (frame.size() < kMinFrameBytes)
            return fail(ErrorCode::MalformedFrame, "a message contains a frame that is too small");
        frames.push_back(frame);
    }
    if (frames.empty()) return fail(ErrorCode::MalformedFrame, "a message contains no frame");
    return frames;
}

Bytes deflate(ByteView raw) {
    thread_local Bytes data;  // keeps its largest size
    data.resize(std::max(data.size(), ZSTD_compressBound(raw.size())));
    const std::size_t size =
        ZSTD_compressCCtx(compressor.get(), data.data(), data.size(), raw.data(), raw.size(), 1);
    if (ZSTD_isError(size)) throw std::runtime_error("zstd cannot compress");
    return {data.begin(), data.begin() + std::ptrdiff_t(size)};
}

Result<void> inflate(ByteView data, std::size_t rawBytes, std::size_t limit, Bytes& raw) {
    if (rawBytes > limit)
        return fail(ErrorCode::MalformedFrame,
                    "a compressed part inflates to more than " + std::to_string(limit) + " bytes");
    // Our encoder always writes the size, so that a bomb is refused before memory is allocated.
    if (ZSTD_getFrameContentSize(data.data(), data.size()) != rawBytes)
        return fail(ErrorCode::MalformedFrame,
                    "a compressed part does not have the size that it names");
    raw.resize(rawBytes);
    const std::size_t size =
        ZSTD_decompressDCtx(decompressor.get(), raw.data(), raw.size(), data.data(), data.size());
    if (ZSTD_isError(size) || size != rawBytes)
        return fail(ErrorCode::MalformedFrame, "a compressed part is damaged");
    return {};
}

Result<Bytes> inflate(ByteView data, std::size_t rawBytes, std::size_t limit) {
    Bytes raw;
    return inflate(data, rawBytes, limit, raw).map([&raw] { return std::move(raw); });
}

Hash chainHash(const Hash& previous, ByteView encodedCommit) {
    return sha256({previous.bytes, encodedCommit});
}

Hash hashAfter(const CommitFrame& frame, const Hash& previous, ByteView encodedFrame) {
    return frame.hashAfter ? *frame.hashAfter : chainHash(previous, encodedFrame);
}

}  // namespace usdlive
