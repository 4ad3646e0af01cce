// The queue of frames for a connection.
#pragma once

#include <cstddef>
#include <vector>

#include "usdlive/common/core/Bytes.h"

namespace usdlive::server {

/// Frames that wait for a connection, in order. Holds references and copies no bytes.
class SendQueue {
public:
    void push(SharedBytes frames);
    /// Moves frames to `out`, which is cleared first: as many as fit into `most` bytes, but at
    /// least one.
    void take(std::size_t most, std::vector<SharedBytes>& out);
    void clear();

    [[nodiscard]] bool empty() const { return entries_.empty(); }
    [[nodiscard]] std::size_t bytes() const { return bytes_; }

private:
    std::vector<SharedBytes> entries_;
    std::size_t bytes_ = 0;
};

}  // namespace usdlive::server
