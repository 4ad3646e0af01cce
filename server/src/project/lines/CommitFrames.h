// The frames in which a commit is stored and sent.
#pragma once

#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

/// How large a commit and its frames may be, in bytes.
struct CommitLimits {
    std::size_t wholeCommit = kMaxFrameBytes;  ///< a larger one goes in parts (FR8)
    std::size_t frame = kMaxFrameBytes;
    std::size_t part = kPartBytes;  ///< about
    std::uint64_t commit = kMaxTransactionBytes;

    [[nodiscard]] std::size_t oneFrame() const { return std::min(wholeCommit, frame); }
};

/// Returns one frame, or where none can hold the commit all its parts one after the other (FR8).
/// nullptr: it is too large for that, too.
[[nodiscard]] SharedBytes encodeCommitFrames(const Commit& commit, const CommitLimits& limits);

}  // namespace usdlive::server
