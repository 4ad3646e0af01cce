// Decodes received messages, on the thread of the network.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string_view>
#include <variant>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/layer/LayerDoc.h"
#include "usdlive/common/protocol/CompactFrame.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

/// The records of a snapshot's chunk (SN2), in order. Constant once it is made, so that threads can
/// share it.
struct SnapshotPart {
    struct Spec {
        NodeId node, parent;
        std::uint64_t order;
        SpecKind kind;
        std::string_view name;
    };
    /// A field of the last spec, which may be in an earlier part.
    struct Field {
        std::string_view name;
        FieldValue value;
    };

    bool first = false;
    std::vector<std::variant<Spec, Field>> records;
    Bytes names;  ///< the bytes that the names of `records` refer to
};

struct ReceivedCommit {
    Commit commit;
    Hash hashAfter;  ///< chain hash (CH1) after it, computed from the previous hash that it names
    /// From a compact frame (FR9): `hashAfter` was sent, and the commit names only the beginning of
    /// the previous hash.
    bool isCompact = false;
};
struct ReceivedSnapshot {
    std::uint64_t request = 0;
    std::shared_ptr<const SnapshotPart> part;
    std::uint64_t specs = 0;        ///< number of specs so far
    std::optional<LayerDoc> whole;  ///< with the last part: the whole content
};
/// A chunk of a big value (B2).
struct ReceivedBlob {
    Hash hash;
    /// The value, with the last chunk; nullptr before. BlobMismatch: its bytes do not have this
    /// hash; they are dropped.
    Result<SharedBytes> whole;
    std::uint64_t bytes = 0;  ///< bytes of the value that are here with this chunk
};
/// A decoded frame of the server.
using Received = std::variant<ControlMessage, ReceivedCommit, Acceptance, RefusalFrame,
                              PreviewFrame, ReceivedSnapshot, ReceivedBlob>;

struct ReceivedMessage {
    /// In order. An error is the last one: MalformedFrame, InvalidValue ..., or UnknownFrame for a
    /// frame that only clients send.
    std::vector<Result<Received>> frames;
    std::size_t bytes = 0;  ///< the memory that it takes, estimated
};

/// Reads the messages of one connection, in order: the work that does not need the session, and so
/// not the editor's thread. Used by one thread.
class MessageReader {
public:
    /// Incomplete big values. The next connection's reader continues them (TL3).
    struct Begun {
        Bytes bytes;
        int connections = 0;  ///< so many have brought no part of it
    };
    using BegunBlobs = std::map<Hash, Begun>;

    explicit MessageReader(BegunBlobs begun = {});
    ~MessageReader();
    /// Returns the incomplete values. Those that nobody continues are dropped after a while.
    [[nodiscard]] BegunBlobs takeBegun();
    [[nodiscard]] ReceivedMessage read(ByteView message);

private:
    class Snapshot;

    /// Returns nothing for a part of a commit (FR8) that is not the last one, and for names (FR10).
    Result<std::optional<Received>> readFrame(ByteView frame, std::size_t& bytes);
    Result<std::optional<Received>> readCompact(ByteView frame, std::size_t& bytes);
    Result<std::optional<Received>> readCommit(CommitFrame& frame, ByteView encoded);
    Result<Received> readControl(const ControlFrame& control);
    Result<ReceivedSnapshot> readSnapshot(const SnapshotFrame& chunk);
    Result<SharedBytes> readBlob(const BlobFrame& part);
    Result<SharedBytes> add(const BlobFrame& part, Bytes& bytes) const;

    CompactReader compact_;
    // Incomplete ones.
    std::map<std::uint64_t, std::unique_ptr<Snapshot>> snapshots_;  // by request
    BegunBlobs blobs_;
    std::optional<CommitParts> commit_;
    std::uint64_t maxBlobBytes_ = 0;  // the limit in the welcome
};

}  // namespace usdlive::client
