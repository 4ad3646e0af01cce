// Finds the revision up to which the history may be replaced by a base (CH4).
#include "project/CommitContent.h"
#include "project/Project.h"

namespace usdlive::server {

namespace {

/// Returns the time of a commit. Decodes only a small part of a large one: the first frame of a
/// commit in parts, or the stub of an import.
Result<std::int64_t> timeOf(const StoredCommit& stored) {
    StoredCommit read = stored;
    std::size_t offset = 0;
    if (isInParts(*stored.frame))
        read.frame = std::make_shared<const Bytes>(nextPart(*stored.frame, offset));
    auto stub = importStub(withoutLength(*read.frame), stored.hash);
    if (!stub) return tl::unexpected(stub.error());
    if (*stub) read.frame = std::make_shared<const Bytes>(std::move(**stub));
    return decodeCommit(read).map([](const Commit& commit) { return commit.timeMs; });
}

}  // namespace

Result<std::int64_t> timeOf(const CommitStore& store, Revision revision) {
    Result<std::int64_t> time = fail(ErrorCode::StorageCorrupt,
                                     "commit " + std::to_string(revision) + " is not in the store");
    const auto read = store.read(revision, revision, [&](const StoredCommit& commit) {
        time = timeOf(commit);
        return false;
    });
    if (!read) return tl::unexpected(read.error());
    return time;
}

/// Searches by bisection: times never fall (CH6), except in stores of earlier versions.
Result<BaseLimit> findBase(const CommitStore& store, std::int64_t beforeMs, Revision upTo) {
    BaseLimit limit{store.base().revision, {}};
    for (Revision newer = upTo + 1; limit.revision + 1 < newer;) {
        const Revision middle = limit.revision + (newer - limit.revision) / 2;
        const auto time = timeOf(store, middle);
        if (!time) return tl::unexpected(time.error());
        (*time < beforeMs ? limit.revision : newer) = middle;
    }
    const auto checkpoints = store.checkpoints();
    if (!checkpoints) return tl::unexpected(checkpoints.error());
    for (const Checkpoint& checkpoint : *checkpoints) {
        if (checkpoint.revision >= limit.revision) continue;
        limit = {checkpoint.revision, "the checkpoint '" + checkpoint.name + "' of revision " +
                                          std::to_string(checkpoint.revision)};
    }
    return limit;
}

}  // namespace usdlive::server
