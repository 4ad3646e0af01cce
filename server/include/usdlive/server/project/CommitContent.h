// What commits hold, as they are stored.
#pragma once

#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

inline constexpr std::size_t kFrameLengthBytes = 4;
/// Returns the part of a commit's frame that its chain hash is made of, and that decodeFrame()
/// takes. (A commit in parts, FR8, is stored as one message of all its frames; its hash is made of
/// all but the first length.)
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

/// The error for a request of a `revision` that is older than `base`, where the history begins
/// (CH4).
[[nodiscard]] tl::unexpected<Error> historyReplaced(Revision revision, Revision base);

// A layer is what its commits say. These fail with StorageCorrupt, which names the commit: what is
// stored was executed once.

[[nodiscard]] Result<Commit> decodeCommit(const StoredCommit& stored);

/// Executes the commit's edits of the layer on `doc`, the layer as it was before.
[[nodiscard]] Result<void> replay(LayerDoc& doc, const LayerId& layer, const Commit& commit);

}  // namespace usdlive::server
