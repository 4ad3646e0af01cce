// Encodes commits as the frames that are stored and sent.
#pragma once

#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

/// The limits for the size of a commit and its frames, in bytes.
struct CommitLimits {
    std::size_t wholeCommit = kMaxFrameBytes;  ///< a larger commit is sent in parts (FR8)
    std::size_t frame = kMaxFrameBytes;
    std::size_t part = kPartBytes;  ///< the approximate size of a part
    std::uint64_t commit = kMaxTransactionBytes;

    [[nodiscard]] std::size_t oneFrame() const { return std::min(wholeCommit, frame); }
};

/// Returns one frame, or all parts of the commit one after the other if it is too large for one
/// frame (FR8). Returns nullptr if it is too large for parts, too.
[[nodiscard]] SharedBytes encodeCommitFrames(const Commit& commit, const CommitLimits& limits);

}  // namespace usdlive::server
