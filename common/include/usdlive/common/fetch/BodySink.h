// Takes what arrives from a server.
#pragma once

#include <cstddef>
#include <span>
#include <string>

namespace usdlive::fetch {

/// Receives the body of an answer in parts, on the thread that requests it.
class BodySink {
public:
    virtual ~BodySink() = default;
    /// Returns the memory for the next part. May wait.
    [[nodiscard]] virtual std::span<char> space() = 0;
    /// Takes the first `size` bytes of the memory that `space()` returned. Returns an empty text,
    /// or the reason why the request ends.
    [[nodiscard]] virtual std::string add(std::size_t size) = 0;
};

}  // namespace usdlive::fetch
