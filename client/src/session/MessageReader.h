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
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

/// What a chunk of a snapshot says (SN2), in its order. Never changed once it is made, so that
/// threads share it.
struct SnapshotPart {
    struct Spec {
        NodeId node, parent;
        std::uint64_t order;
        SpecKind kind;
        std::string_view name;
    };
    /// Of the last spec, which may be of a part before.
    struct Field {
        std::string_view name;
        FieldValue value;
    };

    bool first = false;
    std::vector<std::variant<Spec, Field>> records;
    Bytes names;  ///< what they look into
};

struct ReceivedCommit {
    Commit commit;
    Hash hashAfter;  ///< CH1, of the commit before that it names
};
struct ReceivedSnapshot {
    std::uint64_t request = 0;
    std::shared_ptr<const SnapshotPart> part;
    std::uint64_t specs = 0;        ///< with those of the parts before
    std::optional<LayerDoc> whole;  ///< with the last part: what all of them say
};
/// A part of a big value (B2).
struct ReceivedBlob {
    Hash hash;
    /// With the last part; nullptr before. BlobMismatch: it is not what its name says, and nothing
    /// is kept of it.
    Result<SharedBytes> whole;
};
/// A frame of the server, read.
using Received = std::variant<ControlMessage, ReceivedCommit, RefusalFrame, PreviewFrame,
                              ReceivedSnapshot, ReceivedBlob>;

struct ReceivedMessage {
    /// In order. Nothing follows an error: MalformedFrame, InvalidValue, ..., or UnknownFrame for
    /// what no server sends.
    std::vector<Result<Received>> frames;
    std::size_t bytes = 0;  ///< about what it takes in memory
};

/// Reads the messages of one connection, in their order: what can be done without knowing the
/// session, so that it is not done on the editor's thread. One thread.
class MessageReader {
public:
    MessageReader();
    ~MessageReader();
    [[nodiscard]] ReceivedMessage read(ByteView message);

private:
    class Snapshot;

    /// Nothing: a part of a commit (FR8), and not its last.
    Result<std::optional<Received>> readFrame(ByteView frame, std::size_t& bytes);
    Result<std::optional<Received>> readCommit(CommitFrame& frame, ByteView encoded);
    Result<Received> readControl(const ControlFrame& control);
    Result<ReceivedSnapshot> readSnapshot(const SnapshotFrame& chunk);
    Result<SharedBytes> readBlob(const BlobFrame& part);
    Result<SharedBytes> add(const BlobFrame& part, Bytes& bytes) const;

    // What is on its way.
    std::map<std::uint64_t, std::unique_ptr<Snapshot>> snapshots_;  // by request
    std::map<Hash, Bytes> blobs_;
    std::optional<CommitParts> commit_;
    std::uint64_t maxBlobBytes_ = 0;  // as the server has said
};

}  // namespace usdlive::client
