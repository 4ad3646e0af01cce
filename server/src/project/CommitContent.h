// Reads the content of stored commits.
#pragma once

#include <vector>

#include "project/CommitStore.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

/// The size of the length prefix of a frame, in bytes.
inline constexpr std::size_t kFrameLengthBytes = 4;
/// Returns a stored frame without its length prefix: the input of decodeFrame() and of the chain
/// hash. A commit in parts (FR8) is stored as one message with all its frames; only the length of
/// the first frame is removed. Precondition: `frame` has at least kFrameLengthBytes.
[[nodiscard]] inline ByteView withoutLength(ByteView frame) {
    return frame.subspan(kFrameLengthBytes);
}

/// Returns whether a stored commit consists of several frames (FR8).
[[nodiscard]] bool isInParts(const Bytes& frame);
/// Returns the frame that begins at `offset`, with its length prefix, and moves `offset` to the
/// next frame. Precondition: `offset` is less than the size.
[[nodiscard]] Bytes nextPart(const Bytes& frame, std::size_t& offset);

/// Returns the moves and deletes among the executed edits of the commit `revision`, in order.
[[nodiscard]] std::vector<NamespaceChange> namespaceChanges(Revision revision,
                                                            const std::vector<ExecutedEdit>& edits);

/// Returns the error HistoryReplaced for a request of `revision`, which is not newer than `base`,
/// the start of the history (CH4).
[[nodiscard]] tl::unexpected<Error> historyReplaced(Revision revision, Revision base);

// A stored commit was executed before. If it cannot be decoded or executed again, the store is
// damaged: the following functions fail with StorageCorrupt, and the message names the commit.

/// Decodes a stored commit, also one in parts.
[[nodiscard]] Result<Commit> decodeCommit(const StoredCommit& stored);

/// Executes the commit's edits of `layer` on `doc`, which is the layer before the commit.
[[nodiscard]] Result<void> replay(LayerDoc& doc, const LayerId& layer, const Commit& commit);

}  // namespace usdlive::server
