#pragma once

#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

inline constexpr std::size_t kFrameLengthBytes = 4;
/// Of a commit's frame what its chain hash is made of, and what decodeFrame() takes. (A commit in
/// parts, FR8, is stored as one message of all its frames; its hash is made of the rest of that.)
[[nodiscard]] inline ByteView withoutLength(ByteView frame) {
    return frame.subspan(kFrameLengthBytes);
}

/// Are these the frames of a commit in parts?
[[nodiscard]] bool isInParts(const Bytes& frame);
/// The frame of such a commit that begins at `offset`, with its length; moves `offset` behind it.
[[nodiscard]] Bytes nextPart(const Bytes& frame, std::size_t& offset);

/// The moves and deletes among the executed edits of a commit.
[[nodiscard]] std::vector<NamespaceChange> namespaceChanges(Revision revision,
                                                            const std::vector<ExecutedEdit>& edits);

/// What stood at `revision` is asked for, and the history begins at `base` (CH4).
[[nodiscard]] tl::unexpected<Error> historyReplaced(Revision revision, Revision base);

// A layer is what its commits say. These fail with StorageCorrupt, which names the commit: what is
// stored was executed once.

[[nodiscard]] Result<Commit> decodeCommit(const StoredCommit& stored);

/// What the commit does to the layer, done to `doc`, which is the layer as it was before.
[[nodiscard]] Result<void> replay(LayerDoc& doc, const LayerId& layer, const Commit& commit);

}  // namespace usdlive::server
