// Decompresses what arrives from a server.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "usdlive/common/fetch/BodySink.h"

namespace usdlive::fetch {

/// Receives a zstd frame in parts, and writes its content into another sink (AS5).
class Inflated final : public BodySink {
public:
    /// The server compresses nothing larger. A frame that claims to be larger is refused.
    static constexpr std::uint64_t kMostBytes = std::uint64_t(64) << 20;

    /// `target` outlives it.
    explicit Inflated(BodySink& target);
    ~Inflated() override;

    [[nodiscard]] std::span<char> space() override { return part_; }
    [[nodiscard]] std::string add(std::size_t size) override;
    /// Call it at the end of the body. Returns an empty text, or why the content is not complete.
    [[nodiscard]] std::string finish() const;

private:
    struct Stream;
    BodySink& target_;
    std::vector<char> part_;
    std::unique_ptr<Stream> stream_;
    std::uint64_t inflated_ = 0;
    bool isComplete_ = false;
};

}  // namespace usdlive::fetch
