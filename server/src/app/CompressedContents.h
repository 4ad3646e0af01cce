// Contents of answers over HTTP in memory, and as zstd frames.
#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "app/LastUsed.h"
#include "transport/HttpServer.h"
#include "usdlive/common/core/Bytes.h"

namespace usdlive::server {

/// A content in memory.
class BytesContent final : public HttpContent {
public:
    explicit BytesContent(std::shared_ptr<const Bytes> bytes) : bytes_(std::move(bytes)) {}
    [[nodiscard]] std::uint64_t size() const override { return bytes_->size(); }
    [[nodiscard]] Result<void> read(std::uint64_t offset, std::span<std::uint8_t> part) override;

private:
    const std::shared_ptr<const Bytes> bytes_;
};

/// Compresses contents, and keeps the last ones. Any thread.
class CompressedContents {
public:
    /// AS5: the sizes that are compressed, and the part of its size to which a content must shrink.
    static constexpr std::uint64_t kLeastBytes = 1024, kMostBytes = std::uint64_t(64) << 20;
    static constexpr double kLeastGain = 0.8;

    /// Returns the content as one zstd frame with its size. Returns nullptr if that does not pay,
    /// or if the content cannot be read. `name` identifies the content. Takes up to a second.
    [[nodiscard]] std::shared_ptr<HttpContent> of(const std::string& name, HttpContent& content);

private:
    static constexpr std::size_t kKeptBytes = std::size_t(64) << 20;

    std::mutex mutex_;  // guards the next member
    // By name. nullptr: does not pay.
    LastUsed<std::string, std::shared_ptr<const Bytes>> frames_{kKeptBytes};
};

}  // namespace usdlive::server
