// The rules that all commit stores share.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "project/CommitContent.h"
#include "usdlive/common/protocol/Control.h"

// Rules that all commit stores share.
namespace usdlive::server {

inline constexpr std::uint64_t kRemembered = 1'024;  ///< transactions of a client (M9)
/// If there are too many clients, the oldest fifth is forgotten at once.
inline constexpr std::size_t kForgetPart = 5;

/// Checks that the commits continue the log after `head`. A wrong number or hash would make the
/// store unreadable from there on.
inline Result<void> mayAppend(std::span<const CommitRecord> commits, CommitStore::Head head) {
    for (const CommitRecord& commit : commits) {
        if (commit.revision != head.revision + 1)
            return fail(ErrorCode::Internal, "commit " + std::to_string(commit.revision) +
                                                 " was appended to revision " +
                                                 std::to_string(head.revision));
        if (!commit.frame || commit.frame->size() < kFrameLengthBytes ||
            chainHash(head.hash, withoutLength(*commit.frame)) != commit.hash)
            return fail(ErrorCode::Internal, "commit " + std::to_string(commit.revision) +
                                                 " was appended with a wrong hash");
        head.revision = commit.revision;
        head.hash = commit.hash;
    }
    return {};
}

/// `head` is the store's newest revision; `known`: the name exists.
inline Result<void> mayAdd(const Checkpoint& checkpoint, Revision head, bool known) {
    if (checkpoint.revision > head)
        return fail(ErrorCode::FutureRevision, "the newest revision is " + std::to_string(head));
    if (known)
        return fail(ErrorCode::CheckpointExists,
                    "there is a checkpoint '" + checkpoint.name + "' already");
    return {};
}

}  // namespace usdlive::server
