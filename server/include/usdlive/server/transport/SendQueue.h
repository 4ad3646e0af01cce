#pragma once

#include <cstddef>
#include <vector>

#include "usdlive/common/core/Bytes.h"

namespace usdlive::server {

/// Frames that wait for a connection, first in, first out. Holds references, never copies.
class SendQueue {
public:
    void push(SharedBytes frames);
    /// Moves entries into `out` (emptied first), all of them if they are at most `most` bytes, else
    /// as many as fit, but one at least.
    void take(std::size_t most, std::vector<SharedBytes>& out);
    void clear();

    [[nodiscard]] bool empty() const { return entries_.empty(); }
    [[nodiscard]] std::size_t bytes() const { return bytes_; }

private:
    std::vector<SharedBytes> entries_;
    std::size_t bytes_ = 0;
};

}  // namespace usdlive::server
