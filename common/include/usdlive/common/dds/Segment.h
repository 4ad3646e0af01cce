// The segments and marks of a stream over DDS.
#pragma once

#include <cstdint>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/protocol/Control.h"  // Revision

namespace usdlive::dds {

/// Relates a position in a Reply stream to the samples of other topics (DD6, DD11, DD12).
struct StreamMark {
    Revision afterCommit = 0;  ///< the position is after this commit; 0: before the first
    bool hold = false;         ///< take no commits from the topic from here on...
    Revision liveFrom = 0;     ///< ...and after it take them again from this one on; 0: not yet
    /// From here on, take layer states or presences with at least this number from their topic. 0:
    /// this mark starts none.
    std::uint64_t statesFrom = 0, presencesFrom = 0;

    [[nodiscard]] bool startsUpdates() const { return statesFrom != 0 || presencesFrom != 0; }

    bool operator==(const StreamMark&) const = default;
};

/// The part of a stream in one sample: whole messages, or a piece of one.
struct Segment {
    std::uint64_t sequence = 0;  ///< 1, 2, 3 ...
    StreamMark mark;
    bool more = false;  ///< the next segment continues the same message
    bool end = false;   ///< the last segment: the sender leaves
    SharedBytes owner;  ///< owns the bytes
    ByteView bytes;
};

/// Limits of the unacknowledged part of one stream. A writer keeps more (kStreamDepth of Topics.h),
/// so that DDS never drops a sample for a newer one.
inline constexpr std::uint64_t kWindowSegments = 256;
inline constexpr std::size_t kWindowBytes = 4 * 1024 * 1024;
inline constexpr std::size_t kSegmentBytes = 256 * 1024;

}  // namespace usdlive::dds
