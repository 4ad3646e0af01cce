#include "usdlive/common/protocol/Frame.h"

#include <zstd.h>

#include <stdexcept>

#include "usdlive/common/core/ByteStream.h"

namespace usdlive {

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
            return fail(ErrorCode::MalformedFrame, "a message holds what is too small for a frame");
        frames.push_back(frame);
    }
    if (frames.empty()) return fail(ErrorCode::MalformedFrame, "a message holds no frame");
    return frames;
}

Bytes deflate(ByteView raw) {
    Bytes data(ZSTD_compressBound(raw.size()));
    const std::size_t size = ZSTD_compress(data.data(), data.size(), raw.data(), raw.size(), 1);
    if (ZSTD_isError(size)) throw std::runtime_error("zstd cannot compress");
    data.resize(size);
    return data;
}

Result<Bytes> inflate(ByteView data, std::size_t rawBytes, std::size_t limit) {
    if (rawBytes > limit)
        return fail(ErrorCode::MalformedFrame,
                    "a compressed part inflates to more than " + std::to_string(limit) + " bytes");
    // Our own encoder always writes the size, so that a bomb is known before anything is allocated.
    if (ZSTD_getFrameContentSize(data.data(), data.size()) != rawBytes)
        return fail(ErrorCode::MalformedFrame, "a compressed part is not of the size it claims");
    Bytes raw(rawBytes);
    const std::size_t size = ZSTD_decompress(raw.data(), raw.size(), data.data(), data.size());
    if (ZSTD_isError(size) || size != rawBytes)
        return fail(ErrorCode::MalformedFrame, "a compressed part is damaged");
    return raw;
}

Hash chainHash(const Hash& previous, ByteView encodedCommit) {
    return sha256({previous.bytes, encodedCommit});
}

Hash hashAfter(const CommitFrame& frame, const Hash& previous, ByteView encodedFrame) {
    return frame.hashAfter ? *frame.hashAfter : chainHash(previous, encodedFrame);
}

}  // namespace usdlive
