#pragma once

#include <cstdint>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/protocol/Control.h"  // Revision

namespace usdlive::dds {

/// Where a part of a Reply stream stands among what comes by other topics (DD6, DD11, DD12).
struct StreamMark {
    Revision afterCommit = 0;  ///< it follows this commit; 0: no commit yet
    bool hold = false;         ///< no commits from the topic from here on...
    Revision liveFrom = 0;     ///< ...and after it these, unless 0
    /// After it layer states, or presences, are taken from their topic, from this number on; 0: not
    /// by this one.
    std::uint64_t statesFrom = 0, presencesFrom = 0;

    [[nodiscard]] bool isOfNews() const { return statesFrom != 0 || presencesFrom != 0; }

    bool operator==(const StreamMark&) const = default;
};

/// What one sample carries of a stream: whole messages, or a piece of one.
struct Segment {
    std::uint64_t sequence = 0;  ///< 1, 2, 3 ...
    StreamMark mark;
    bool more = false;  ///< the next one goes on with the same message
    bool end = false;   ///< the last one: the sender is leaving
    SharedBytes owner;  ///< of the bytes
    ByteView bytes;
};

/// Of one stream: what may be on its way, not acknowledged. Less than a writer keeps (kStreamDepth
/// of Topics.h), so that DDS never drops a sample for a newer one.
inline constexpr std::uint64_t kWindowSegments = 256;
inline constexpr std::size_t kWindowBytes = 4 * 1024 * 1024;
inline constexpr std::size_t kSegmentBytes = 256 * 1024;

}  // namespace usdlive::dds
