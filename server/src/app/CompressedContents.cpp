// Compresses contents of answers over HTTP.
#include "app/CompressedContents.h"

#include <zstd.h>

#include <algorithm>
#include <optional>

namespace usdlive::server {

namespace {

// A beginning of this size shows whether the rest is worth reading.
constexpr std::size_t kSampleBytes = 64 * 1024;
// Counts for each name that is kept, so that their number is bounded, too.
constexpr std::size_t kNameBytes = 64 * 1024;
constexpr int kLevel = 1;  // a network at home or in an office is not much slower than higher ones

std::optional<Bytes> read(HttpContent& content, std::uint64_t size) {
    Bytes bytes(static_cast<std::size_t>(size));
    if (!content.read(0, bytes)) return std::nullopt;
    return bytes;
}

/// Returns an empty frame if it is too large.
Bytes compressed(const Bytes& raw) {
    Bytes frame(ZSTD_compressBound(raw.size()));
    const std::size_t size =
        ZSTD_compress(frame.data(), frame.size(), raw.data(), raw.size(), kLevel);
    const bool isSmall =
        !ZSTD_isError(size) && double(size) <= double(raw.size()) * CompressedContents::kLeastGain;
    frame.resize(isSmall ? size : 0);
    frame.shrink_to_fit();
    return frame;
}

std::shared_ptr<const Bytes> frameOf(HttpContent& content) {
    const auto sample = read(content, std::min<std::uint64_t>(content.size(), kSampleBytes));
    if (!sample || compressed(*sample).empty()) return nullptr;
    const auto whole = read(content, content.size());
    if (!whole) return nullptr;
    Bytes frame = compressed(*whole);
    return frame.empty() ? nullptr : std::make_shared<const Bytes>(std::move(frame));
}

}  // namespace

Result<void> BytesContent::read(std::uint64_t offset, std::span<std::uint8_t> part) {
    std::copy_n(bytes_->begin() + std::ptrdiff_t(offset), part.size(), part.begin());
    return {};
}

std::shared_ptr<HttpContent> CompressedContents::of(const std::string& name, HttpContent& content) {
    if (content.size() < kLeastBytes || content.size() > kMostBytes) return nullptr;
    const auto made = [](const std::shared_ptr<const Bytes>& frame) {
        return frame ? std::make_shared<BytesContent>(frame) : nullptr;
    };
    {
        const std::lock_guard lock(mutex_);
        if (const auto* known = frames_.find(name)) return made(*known);
    }
    const auto frame = frameOf(content);
    const std::lock_guard lock(mutex_);
    // Another request may have made it meanwhile.
    if (!frames_.find(name)) frames_.add(name, frame, kNameBytes + (frame ? frame->size() : 0));
    return made(frame);
}

}  // namespace usdlive::server
