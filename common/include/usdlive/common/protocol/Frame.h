// Frames: the messages between client and server, to bytes and back.
#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// PR1: the protocol versions that this build speaks.
inline constexpr int kProtocolVersion = 2;
inline constexpr int kOldestProtocolVersion = 2;

/// FR2: the largest frame unless configured otherwise, in bytes.
inline constexpr std::size_t kMaxFrameBytes = 64 * 1024 * 1024;
/// The smallest frame, in bytes. It bounds how many frames a message can have.
inline constexpr std::size_t kMinFrameBytes = 16;
/// The largest chunk of a snapshot or a big value before compression. Small edits are sent between
/// two chunks.
inline constexpr std::size_t kChunkBytes = 256 * 1024;

/// JSON (Control.h). Sent by both.
struct ControlFrame {
    std::string json;
    bool operator==(const ControlFrame&) const = default;
};
/// Client to server: a transaction to be committed.
struct SubmitFrame {
    Transaction transaction;
    std::uint32_t part = 0;  ///< FR8: see FrameParts.h
    bool more = false;       ///< another part follows
    bool operator==(const SubmitFrame&) const = default;
};
/// Server to all: a commit. For its author it is the acknowledgement. For a commit that imported a
/// layer (Commit::imported) this is a stub: it has the chain hash instead of the edits.
struct CommitFrame {
    Commit commit;
    std::optional<Hash> hashAfter =
        std::nullopt;        ///< in a stub (CH2) and a conflated one (CF1) only
    std::uint32_t part = 0;  ///< FR8
    bool more = false;
    bool operator==(const CommitFrame&) const = default;
};
/// Server to author: a refused transaction (M6).
struct RefusalFrame {
    std::uint64_t sequence = 0;
    std::uint32_t edit = 0;
    Error error;
    bool operator==(const RefusalFrame&) const = default;
};
/// M11: all edits of a gesture so far. It replaces the earlier preview of the same author and
/// gesture. Without edits, the gesture was withdrawn. The server sets `author` and forwards it.
struct PreviewFrame {
    ClientId author;
    std::uint64_t gesture = 0;
    Revision base = 0;
    std::vector<Edit> edits;
    bool operator==(const PreviewFrame&) const = default;
};
/// A chunk of a layer's content at a revision (SN1-SN4): records compressed with zstd (Snapshot.h).
struct SnapshotFrame {
    std::uint64_t request = 0;  ///< OpenLayer::request
    std::uint32_t index = 0;    ///< 0, 1, 2 ...
    bool last = false;
    std::uint32_t rawBytes = 0;  ///< before compression, at most kChunkBytes
    Bytes data;
    bool operator==(const SnapshotFrame&) const = default;
};
/// A chunk of a big value (V9). A client uploads it, a server sends it on request.
struct BlobFrame {
    Hash hash;
    std::uint64_t size = 0;    ///< size of the whole value
    std::uint64_t offset = 0;  ///< position of this chunk
    std::uint32_t rawBytes = 0;
    Bytes data;                 ///< compressed with zstd
    std::uint64_t gesture = 0;  ///< not 0: only for previews of this gesture, not stored (B3)
    bool operator==(const BlobFrame&) const = default;
};

using Frame = std::variant<ControlFrame, SubmitFrame, CommitFrame, RefusalFrame, PreviewFrame,
                           SnapshotFrame, BlobFrame>;

/// FR1: encodes one frame, with its u32 length in front. A message of a WebSocket is one or more of
/// these.
[[nodiscard]] Bytes encodeFrame(const Frame& frame);

/// The frame of a commit that imports a layer, without its place in the history.
struct ImportFrame {
    Bytes bytes;
    std::size_t edits = 0;
};
/// Encodes a commit that creates all specs of a layer and sets their fields, parents before
/// children. A worker can do this before the commit has its revision. Returns nothing if the frame
/// would have more than about `maxBytes` (at most 1 GiB).
[[nodiscard]] std::optional<ImportFrame> encodeImport(const LayerId& layer, const LayerDoc& doc,
                                                      std::size_t maxBytes);
/// Writes the revision, epoch, time and previous hash of `place` into an ImportFrame.
void stampCommit(Bytes& frame, const Commit& place);

/// Decodes and verifies a frame: the FlatBuffer, enums, names of layers and fields, and values; not
/// paths. Memory is allocated only in proportion to the bytes. Errors: MalformedFrame,
/// UnknownFrame, InvalidLayerName, InvalidValue.
[[nodiscard]] Result<Frame> decodeFrame(ByteView frame);

/// Splits a message into frames (without their lengths). Errors: MalformedFrame, FrameTooLarge.
[[nodiscard]] Result<std::vector<ByteView>> splitMessage(
    ByteView message, std::size_t maxFrameBytes = kMaxFrameBytes);

/// Compress with zstd, and decompress. inflate() checks before it allocates that the content has
/// exactly `rawBytes` and not more than `limit` (MalformedFrame).
[[nodiscard]] Bytes deflate(ByteView raw);
[[nodiscard]] Result<Bytes> inflate(ByteView data, std::size_t rawBytes, std::size_t limit);
/// The same, but reuses the memory of `raw`.
[[nodiscard]] Result<void> inflate(ByteView data, std::size_t rawBytes, std::size_t limit,
                                   Bytes& raw);

/// CH1: the chain hash after a commit: SHA-256 of the previous hash and of the commit's encoded
/// frame without its length. A commit in parts has several frames; all but the first are hashed
/// with their lengths.
[[nodiscard]] Hash chainHash(const Hash& previous, ByteView encodedCommit);
/// The chain hash after a received commit: computed (CH1), or named by a stub (CH2).
[[nodiscard]] Hash hashAfter(const CommitFrame& frame, const Hash& previous, ByteView encodedFrame);

/// CH2: makes the stub, with its length in front, of an encoded commit (without length) that
/// imported a layer. Returns nothing for other commits, which are sent as they are. `hash`: the
/// chain hash after the commit.
[[nodiscard]] Result<std::optional<Bytes>> importStub(ByteView encodedCommit, const Hash& hash);

}  // namespace usdlive
