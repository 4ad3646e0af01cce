#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/Edit.h"
#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

/// PR1: versions of the protocol this build speaks.
inline constexpr int kProtocolVersion = 1;
inline constexpr int kOldestProtocolVersion = 1;

/// FR2: a frame is refused above this size unless configured otherwise, in bytes.
inline constexpr std::size_t kMaxFrameBytes = 64 * 1024 * 1024;
/// No frame is smaller, in bytes; so a message cannot be split into very many.
inline constexpr std::size_t kMinFrameBytes = 16;
/// Snapshot and blob chunks hold at most this much before compression, so that small edits pass
/// between them.
inline constexpr std::size_t kChunkBytes = 256 * 1024;

/// JSON, see Control.h. Both ways.
struct ControlFrame {
    std::string json;
    bool operator==(const ControlFrame&) const = default;
};
/// Client to server: commit this.
struct SubmitFrame {
    Transaction transaction;
    std::uint32_t part = 0;  ///< FR8: see FrameParts.h
    bool more = false;       ///< another part follows
    bool operator==(const SubmitFrame&) const = default;
};
/// Server to all: it is committed. Also the author's acknowledgement. For a commit that brought a
/// whole layer in (Commit::imported) this is a stub without its edits, which names the chain hash
/// instead.
struct CommitFrame {
    Commit commit;
    std::optional<Hash> hashAfter =
        std::nullopt;        ///< in a stub (CH2) and a conflated one (CF1) only
    std::uint32_t part = 0;  ///< FR8
    bool more = false;
    bool operator==(const CommitFrame&) const = default;
};
/// Server to author (M6).
struct RefusalFrame {
    std::uint64_t sequence = 0;
    std::uint32_t edit = 0;
    Error error;
    bool operator==(const RefusalFrame&) const = default;
};
/// M11: the whole of a gesture so far; it takes the place of the one before with the same author
/// and gesture. No edits: the gesture was withdrawn. The server fills in `author` and passes it on.
struct PreviewFrame {
    ClientId author;
    std::uint64_t gesture = 0;
    Revision base = 0;
    std::vector<Edit> edits;
    bool operator==(const PreviewFrame&) const = default;
};
/// A part of a layer's content at a revision (SN1-SN4): zstd-compressed records; see Snapshot.h.
struct SnapshotFrame {
    std::uint64_t request = 0;  ///< OpenLayer::request
    std::uint32_t index = 0;    ///< 0, 1, 2 ...
    bool last = false;
    std::uint32_t rawBytes = 0;  ///< before compression, at most kChunkBytes
    Bytes data;
    bool operator==(const SnapshotFrame&) const = default;
};
/// A part of a big value (V9). Client to server to upload, server to client on request.
struct BlobFrame {
    Hash hash;
    std::uint64_t size = 0;    ///< of the whole value
    std::uint64_t offset = 0;  ///< of this part
    std::uint32_t rawBytes = 0;
    Bytes data;                 ///< zstd
    std::uint64_t gesture = 0;  ///< not 0: only for this gesture's previews, not stored (B3)
    bool operator==(const BlobFrame&) const = default;
};

using Frame = std::variant<ControlFrame, SubmitFrame, CommitFrame, RefusalFrame, PreviewFrame,
                           SnapshotFrame, BlobFrame>;

/// FR1: one frame with its u32 length in front, ready to be sent or joined to others: a WebSocket
/// message is one or more of them.
[[nodiscard]] Bytes encodeFrame(const Frame& frame);

/// The frame of the commit that brings in a whole layer (creates its specs and sets their fields,
/// parents before children) before its turn in the history has come: it is encoded beside the
/// thread that orders. Nothing when it takes about more than `maxBytes` (at most 1 GiB).
struct ImportFrame {
    Bytes bytes;
    std::size_t edits = 0;
};
[[nodiscard]] std::optional<ImportFrame> encodeImport(const LayerId& layer, const LayerDoc& doc,
                                                      std::size_t maxBytes);
/// Its turn: writes the revision, epoch, time and previous hash of `place` into it.
void stampCommit(Bytes& frame, const Commit& place);

/// Verifies everything it hands out (FlatBuffers, then enums, names of layers and fields, values;
/// paths are left to who uses them). Errors: MalformedFrame, UnknownFrame, InvalidLayerName,
/// InvalidValue; nothing is allocated that the bytes do not pay for.
[[nodiscard]] Result<Frame> decodeFrame(ByteView frame);

/// Splits a message into frames (without their lengths). Errors: MalformedFrame, FrameTooLarge.
[[nodiscard]] Result<std::vector<ByteView>> splitMessage(
    ByteView message, std::size_t maxFrameBytes = kMaxFrameBytes);

/// zstd. Inflating refuses what does not have exactly `rawBytes` (MalformedFrame), before
/// allocating.
[[nodiscard]] Bytes deflate(ByteView raw);
[[nodiscard]] Result<Bytes> inflate(ByteView data, std::size_t rawBytes, std::size_t limit);
/// The same, into `raw`, whose memory is used again.
[[nodiscard]] Result<void> inflate(ByteView data, std::size_t rawBytes, std::size_t limit,
                                   Bytes& raw);

/// CH1: the chain hash after a commit: SHA-256 of the hash before and of the commit's encoded frame
/// (without length prefix; of one in parts all frames, each but the first behind its length).
[[nodiscard]] Hash chainHash(const Hash& previous, ByteView encodedCommit);
/// The same for a commit frame as it was received: CH1, or what a stub names (CH2).
[[nodiscard]] Hash hashAfter(const CommitFrame& frame, const Hash& previous, ByteView encodedFrame);

/// CH2: the stub of an encoded commit (without length prefix) that brought a layer in, with its
/// length prefix; nothing for any other commit, which is broadcast as it is. `hash`: the chain hash
/// after it.
[[nodiscard]] Result<std::optional<Bytes>> importStub(ByteView encodedCommit, const Hash& hash);

}  // namespace usdlive
