// Decodes received messages: frames, hashes, snapshots, big values.
#include "session/MessageReader.h"

#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/protocol/ServerControl.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::client {

namespace {

// More than any session requests at the same time.
constexpr std::size_t kMaxArriving = 10'000;
constexpr std::size_t kEditBytes = 256;  // without its texts and values, estimated
// The connections that an incomplete big value outlives without another part.
constexpr int kMostConnections = 8;

}  // namespace

/// A snapshot that arrives: builds the doc, and passes on each chunk.
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

MessageReader::MessageReader(BegunBlobs begun) : blobs_(std::move(begun)) {}
MessageReader::~MessageReader() = default;

MessageReader::BegunBlobs MessageReader::takeBegun() {
    for (auto entry = blobs_.begin(); entry != blobs_.end();)
        entry = ++entry->second.connections > kMostConnections ? blobs_.erase(entry) : ++entry;
    return std::exchange(blobs_, {});
}

ReceivedMessage MessageReader::read(ByteView message) {
    ReceivedMessage received{{}, message.size()};
    const auto frames = splitMessage(message);
    if (!frames) {
        received.frames.emplace_back(tl::unexpected(frames.error()));
        return received;
    }
    received.frames.reserve(frames->size());
    received.bytes += frames->size() * sizeof received.frames.front();
    for (const ByteView encoded : *frames) {
        auto frame = readFrame(encoded, received.bytes);
        if (!frame) {
            received.frames.emplace_back(tl::unexpected(frame.error()));
            break;
        }
        if (*frame) received.frames.emplace_back(std::move(**frame));
    }
    return received;
}

Result<std::optional<Received>> MessageReader::readFrame(ByteView encoded, std::size_t& bytes) {
    if (isCompact(encoded)) return readCompact(encoded, bytes);
    auto frame = decodeFrame(encoded);
    if (!frame) return tl::unexpected(frame.error());
    return std::visit(
        Overloaded{[&](ControlFrame& control) -> Result<std::optional<Received>> {
                       return readControl(control);
                   },
                   [&](CommitFrame& commit) -> Result<std::optional<Received>> {
                       bytes += kEditBytes * commit.commit.edits.size();
                       return readCommit(commit, encoded);
                   },
                   [&](SnapshotFrame& chunk) -> Result<std::optional<Received>> {
                       auto received = readSnapshot(chunk);
                       if (!received) return tl::unexpected(received.error());
                       const SnapshotPart& part = *received->part;
                       bytes +=
                           part.names.size() + part.records.size() * sizeof part.records.front();
                       return std::move(*received);
                   },
                   [&](PreviewFrame& preview) -> Result<std::optional<Received>> {
                       bytes += kEditBytes * preview.edits.size();
                       return std::move(preview);
                   },
                   [&](BlobFrame& part) -> Result<std::optional<Received>> {
                       return ReceivedBlob{part.hash, readBlob(part), part.offset + part.rawBytes};
                   },
                   [](SubmitFrame&) -> Result<std::optional<Received>> {
                       return fail(ErrorCode::UnknownFrame, "a server does not submit");
                   },
                   [](RefusalFrame& refusal) -> Result<std::optional<Received>> {
                       return std::move(refusal);
                   }},
        *frame);
}

Result<std::optional<Received>> MessageReader::readCompact(ByteView encoded, std::size_t& bytes) {
    auto content = compact_.read(encoded);
    if (!content) return tl::unexpected(content.error());
    return std::visit(
        Overloaded{[](std::monostate) -> Result<std::optional<Received>> { return std::nullopt; },
                   [&](CompactCommit& compact) -> Result<std::optional<Received>> {
                       bytes += kEditBytes * compact.commit.edits.size();
                       return ReceivedCommit{std::move(compact.commit), compact.hashAfter, true};
                   },
                   [](Acceptance& acceptance) -> Result<std::optional<Received>> {
                       return std::move(acceptance);
                   },
                   [&](PreviewFrame& preview) -> Result<std::optional<Received>> {
                       bytes += kEditBytes * preview.edits.size();
                       return std::move(preview);
                   },
                   [](SubmitFrame&) -> Result<std::optional<Received>> {
                       return fail(ErrorCode::UnknownFrame, "a server does not submit");
                   }},
        *content);
}

Result<std::optional<Received>> MessageReader::readCommit(CommitFrame& frame, ByteView encoded) {
    if (frame.part == 0) commit_.reset();
    if (frame.part == 0 && !frame.more) {
        const Hash after = hashAfter(frame, frame.commit.previous, encoded);
        return ReceivedCommit{std::move(frame.commit), after};
    }
    if (!commit_) commit_.emplace();
    auto joined = commit_->add(std::move(frame), encoded);
    if (!joined) return tl::unexpected(joined.error());
    if (!*joined) return std::nullopt;
    commit_.reset();
    return ReceivedCommit{std::move((*joined)->commit), (*joined)->hashAfter};
}

Result<Received> MessageReader::readControl(const ControlFrame& control) {
    auto message = decodeServerControl(control.json);
    if (!message) return tl::unexpected(message.error());
    if (const auto* welcome = std::get_if<Welcome>(&*message))
        maxBlobBytes_ = welcome->maxBlobBytes;
    return std::move(*message);
}

Result<ReceivedSnapshot> MessageReader::readSnapshot(const SnapshotFrame& chunk) {
    auto& snapshot = snapshots_[chunk.request];
    if (!snapshot) snapshot = std::make_unique<Snapshot>();
    if (snapshots_.size() > kMaxArriving)
        return fail(ErrorCode::MalformedFrame, "too many snapshots at once");
    auto received = snapshot->add(chunk);
    if (!received || received->whole) snapshots_.erase(chunk.request);
    return received;
}

Result<SharedBytes> MessageReader::readBlob(const BlobFrame& part) {
    const auto entry = blobs_.try_emplace(part.hash).first;
    entry->second.connections = 0;
    auto whole = add(part, entry->second.bytes);
    if (!whole || *whole) blobs_.erase(entry);
    return whole;
}

Result<SharedBytes> MessageReader::add(const BlobFrame& part, Bytes& bytes) const {
    if (part.size > maxBlobBytes_ || part.offset > bytes.size() ||
        part.rawBytes > part.size - part.offset || blobs_.size() > kMaxArriving)
        return fail(ErrorCode::BlobMismatch, "parts of " + part.hash.hex() + " do not fit");
    const auto raw = inflate(part.data, part.rawBytes, kChunkBytes);
    if (!raw) return tl::unexpected(raw.error());
    bytes.resize(part.offset);  // the session may not have seen the last parts before a cut
    bytes.reserve(part.size);
    bytes.insert(bytes.end(), raw->begin(), raw->end());
    if (bytes.size() < part.size) return nullptr;
    if (sha256(bytes) != part.hash)
        return fail(ErrorCode::BlobMismatch, "the bytes of " + part.hash.hex() + " are others");
    return std::make_shared<const Bytes>(std::move(bytes));
}

}  // namespace usdlive::client
