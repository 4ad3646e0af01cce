// Encodes a commit as one frame, or as several if it is too large for one.
#include "project/lines/CommitFrames.h"

#include <algorithm>

#include "project/CommitContent.h"
#include "usdlive/common/core/ByteStream.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kSurelyDecoded = 8 * 1024;  // a frame of this size never exceeds the budget
constexpr std::size_t kLeastEditBytes = 32;       // FR7

}  // namespace

SharedBytes encodeCommitFrames(const Commit& commit, const CommitLimits& limits) {
    if (leastFrameBytes(commit.edits) <= limits.oneFrame()) {
        Bytes frame = encodeFrame(CommitFrame{commit});
        const ByteView encoded = withoutLength(frame);
        // FR7: clients refuse a frame that refers to the same content too often.
        if (encoded.size() <= limits.oneFrame() &&
            (encoded.size() <= kSurelyDecoded || decodeFrame(encoded)))
            return std::make_shared<const Bytes>(std::move(frame));
    }
    Bytes frames;
    for (PartsAt at; !at.isEnd;) {
        const std::size_t before = at.edit + at.dropped;
        const Bytes part = encodePart(commit, at, std::min(limits.part, limits.frame / 2));
        const std::size_t edits = at.edit + at.dropped - before;
        if (withoutLength(part).size() > limits.frame ||
            withoutLength(part).size() < edits * kLeastEditBytes ||
            frames.size() + part.size() > limits.commit)
            return nullptr;
        appendBytes(frames, part);
    }
    if (!isInParts(frames) && !decodeFrame(withoutLength(frames))) return nullptr;
    return std::make_shared<const Bytes>(std::move(frames));
}

}  // namespace usdlive::server
