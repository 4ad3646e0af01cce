#include "usdlive/client/session/MessageReader.h"

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::client {

namespace {

// More than any session asks for at once.
constexpr std::size_t kMaxSnapshots = 10'000;
constexpr std::size_t kEditBytes = 256;  // beside its texts and values, about

}  // namespace

/// Its content becomes a doc and, chunk by chunk, what others make something of.
class MessageReader::Snapshot final : public SnapshotRecords {
public:
    Result<ReceivedSnapshot> add(const SnapshotFrame& chunk) {
        part_ = std::make_shared<SnapshotPart>();
        part_->first = chunk.index == 0;
        const auto whole = reader_.add(chunk);
        if (!whole) return tl::unexpected(whole.error());
        part_->names = reader_.takeBytes();
        part_->records.shrink_to_fit();
        ReceivedSnapshot received{chunk.request, std::move(part_), reader_.specs(), {}};
        if (*whole) received.whole = builder_.finish();
        return received;
    }

    Result<void> spec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                      std::string_view name) override {
        node_ = node;
        part_->records.emplace_back(SnapshotPart::Spec{node, parent, order, kind, name});
        return builder_.addSpec(node, parent, order, kind, name).map_error(malformed);
    }
    Result<void> field(std::string_view name, FieldValue value) override {
        part_->records.emplace_back(SnapshotPart::Field{name, value});
        return builder_.addField(node_, name, std::move(value)).map_error(malformed);
    }

private:
    static Error malformed(const Error& error) {
        return {ErrorCode::MalformedFrame, error.message};
    }

    SnapshotReader reader_{*this};
    LayerDoc::Builder builder_;
    NodeId node_ = 0;
    std::shared_ptr<SnapshotPart> part_;
};

MessageReader::MessageReader() = default;
MessageReader::~MessageReader() = default;

ReceivedMessage MessageReader::read(ByteView message) {
    ReceivedMessage received{{}, message.size()};
    const auto frames = splitMessage(message);
    if (!frames) {
        received.frames.emplace_back(tl::unexpected(frames.error()));
        return received;
    }
    received.frames.reserve(frames->size());
    received.bytes += frames->size() * sizeof received.frames.front();
    for (const ByteView frame : *frames)
        if (!received.frames.emplace_back(readFrame(frame, received.bytes))) break;
    return received;
}

Result<Received> MessageReader::readFrame(ByteView encoded, std::size_t& bytes) {
    auto frame = decodeFrame(encoded);
    if (!frame) return tl::unexpected(frame.error());
    return std::visit(
        Overloaded{
            [](ControlFrame& control) -> Result<Received> { return decodeControl(control.json); },
            [&](CommitFrame& commit) -> Result<Received> {
                bytes += kEditBytes * commit.commit.edits.size();
                const Hash after = hashAfter(commit, commit.commit.previous, encoded);
                return ReceivedCommit{std::move(commit.commit), after};
            },
            [&](SnapshotFrame& chunk) -> Result<Received> {
                auto received = readSnapshot(chunk);
                if (!received) return tl::unexpected(received.error());
                const SnapshotPart& part = *received->part;
                bytes += part.names.size() + part.records.size() * sizeof part.records.front();
                return std::move(*received);
            },
            [&](PreviewFrame& preview) -> Result<Received> {
                bytes += kEditBytes * preview.edits.size();
                return std::move(preview);
            },
            [](SubmitFrame&) -> Result<Received> {
                return fail(ErrorCode::UnknownFrame, "a server does not submit");
            },
            [](auto& other) -> Result<Received> { return std::move(other); }},
        *frame);
}

Result<ReceivedSnapshot> MessageReader::readSnapshot(const SnapshotFrame& chunk) {
    auto& snapshot = snapshots_[chunk.request];
    if (!snapshot) snapshot = std::make_unique<Snapshot>();
    if (snapshots_.size() > kMaxSnapshots)
        return fail(ErrorCode::MalformedFrame, "too many snapshots at once");
    auto received = snapshot->add(chunk);
    if (!received || received->whole) snapshots_.erase(chunk.request);
    return received;
}

}  // namespace usdlive::client
