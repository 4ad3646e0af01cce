// A layer's content as records in chunks, and back (SN1-SN4).
#include "usdlive/common/protocol/Snapshot.h"

#include <algorithm>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive {

namespace {

// SN2: the kind of a record.
enum class Record : std::uint8_t { Spec = 1, Field = 2, FieldPart = 3 };

// A chunk ends when it has kFullBytes. A record has at most kFieldPartBytes of content, so that no
// chunk has more than kChunkBytes.
constexpr std::size_t kFullBytes = 128 * 1024;
constexpr std::size_t kFieldPartBytes = 96 * 1024;
constexpr std::uint64_t kMaxFieldBytes = 1ull << 30;  // limit of one field; a decoder refuses more

}  // namespace

struct SnapshotEncoder::State {
    State(LayerDoc doc, std::uint64_t request)
        : walk(std::move(doc)), request(request), spec(walk.next()) {}

    [[nodiscard]] bool done() const { return !spec && rest.empty(); }

    void appendRecord(Bytes& out) {
        if (!rest.empty())
            appendPart(out);
        else if (!begun)
            appendSpec(out);
        else
            appendField(out);
        if (begun && rest.empty() && field == spec->fields->size()) {
            spec = walk.next();
            begun = false;
        }
    }

    LayerDoc::Walk walk;
    std::uint64_t request;
    const LayerDoc::SpecView* spec;
    bool begun = false;     // the record of `spec` is written
    std::size_t field = 0;  // the next of `spec` to write
    Bytes raw;              // content of the chunk being written
    Bytes content;          // content of the field being written
    ByteView rest;          // the rest of `content` that is not written yet
    std::uint32_t chunks = 0;

private:
    void appendSpec(Bytes& out) {
        out.push_back(std::uint8_t(Record::Spec));
        appendNumber<std::uint64_t>(out, spec->node);
        appendNumber<std::uint64_t>(out, spec->parent);
        appendNumber<std::uint64_t>(out, spec->order);
        out.push_back(std::uint8_t(spec->kind));
        appendText(out, spec->name);
        begun = true;
        field = 0;
    }
    void appendField(Bytes& out) {
        const auto& [name, value] = (*spec->fields)[field++];
        content.clear();
        encodeFieldValue(value, content);
        if (content.size() > kFieldPartBytes) {
            rest = content;
            appendPart(out);
            return;
        }
        out.push_back(std::uint8_t(Record::Field));
        appendText(out, name);
        appendNumber<std::uint32_t>(out, std::uint32_t(content.size()));
        appendBytes(out, content);
    }
    void appendPart(Bytes& out) {
        const ByteView part = rest.first(std::min(rest.size(), kFieldPartBytes));
        out.push_back(std::uint8_t(Record::FieldPart));
        appendText(out, (*spec->fields)[field - 1].first);
        appendNumber<std::uint64_t>(out, content.size());
        appendNumber<std::uint32_t>(out, std::uint32_t(part.size()));
        appendBytes(out, part);
        rest = rest.subspan(part.size());
    }
};

SnapshotEncoder::SnapshotEncoder(LayerDoc doc, std::uint64_t request)
    : state_(std::make_unique<State>(std::move(doc), request)) {}
SnapshotEncoder::~SnapshotEncoder() = default;

std::optional<SnapshotFrame> SnapshotEncoder::next(std::size_t most) {
    if (state_->done()) return std::nullopt;
    Bytes& raw = state_->raw;
    raw.clear();
    while (!state_->done() && raw.size() < std::min(most, kFullBytes)) state_->appendRecord(raw);
    return SnapshotFrame{state_->request, state_->chunks++, state_->done(),
                         std::uint32_t(raw.size()), deflate(raw)};
}

struct SnapshotReader::State {
    explicit State(SnapshotRecords& to) : records(to) {}

    Result<void> addChunk(ByteView raw) {
        ByteReader reader(raw);
        while (reader.left() != 0) {
            auto added = addRecord(reader);
            if (!added) return added;
        }
        return {};
    }

    SnapshotRecords& records;
    std::uint64_t specs = 0;
    std::uint32_t chunks = 0;
    bool last = false;
    std::optional<Error> failed;
    Bytes raw;  // content of the chunk being read

    [[nodiscard]] bool inField() const { return !part.empty(); }

private:
    static tl::unexpected<Error> malformed(const char* message) {
        return fail(ErrorCode::MalformedFrame, message);
    }

    Result<void> addRecord(ByteReader& reader) {
        const auto record = Record(reader.u8());
        if (inField() && record != Record::FieldPart)
            return malformed("a snapshot's field is not complete");
        switch (record) {
            case Record::Spec:
                return addSpec(reader);
            case Record::Field:
                return addField(reader);
            case Record::FieldPart:
                return addPart(reader);
        }
        return malformed("a snapshot's record is of an unknown kind");
    }

    Result<void> addSpec(ByteReader& reader) {
        const std::uint64_t id = reader.u64(), parent = reader.u64(), order = reader.u64();
        const auto kind = SpecKind(reader.u8());
        const std::string_view name = reader.text();
        if (reader.failed()) return malformed("a snapshot's spec is cut short");
        const bool isRoot = kind == SpecKind::PseudoRoot;
        if (isRoot != (specs == 0) || isRoot != (id == kRootNode))
            return malformed("a snapshot does not begin with its root");
        ++specs;
        return records.spec(id, parent, order, kind, name);
    }

    Result<void> addField(ByteReader& reader) {
        const std::string_view name = reader.text();
        const ByteView bytes = reader.take(reader.u32());
        if (reader.failed()) return malformed("a snapshot's field is cut short");
        return put(name, bytes);
    }

    Result<void> addPart(ByteReader& reader) {
        const std::string_view name = reader.text();
        const std::uint64_t size = reader.u64();
        const ByteView bytes = reader.take(reader.u32());
        if (reader.failed() || bytes.empty()) return malformed("a snapshot's field is cut short");
        if (!inField()) {
            partName = name;
            partSize = size;
        }
        if (name != partName || size != partSize || size > kMaxFieldBytes ||
            part.size() + bytes.size() > size)
            return malformed("a snapshot's field has parts that do not fit");
        appendBytes(part,
                    bytes);  // grows with the received bytes, not by the size that the record names
        if (part.size() < size) return {};
        auto done = put(name, part);  // the names of all parts are the same
        part = {};
        return done;
    }

    Result<void> put(std::string_view name, ByteView bytes) {
        if (specs == 0 || name.empty() || !isUtf8(name))
            return malformed("a snapshot's field has no spec or no name");
        auto value = decodeFieldValue(bytes);
        if (!value) return tl::unexpected(value.error());
        return records.field(name, std::move(*value));
    }

    std::string partName;
    std::uint64_t partSize = 0;
    Bytes part;
};

SnapshotReader::SnapshotReader(SnapshotRecords& records)
    : state_(std::make_unique<State>(records)) {}
SnapshotReader::~SnapshotReader() = default;

Result<bool> SnapshotReader::add(const SnapshotFrame& frame) {
    if (state_->failed) return tl::unexpected(*state_->failed);
    const auto failWith = [this](Error error) {
        state_->failed = error;
        return tl::unexpected(std::move(error));
    };
    if (state_->last || frame.index != state_->chunks++)
        return failWith({ErrorCode::MalformedFrame, "a snapshot's chunks are out of order"});
    const auto added =
        inflate(frame.data, frame.rawBytes, kChunkBytes, state_->raw).and_then([this] {
            return state_->addChunk(state_->raw);
        });
    if (!added) return failWith(added.error());
    state_->last = frame.last;
    if (frame.last && (state_->inField() || state_->specs == 0))
        return failWith({ErrorCode::MalformedFrame, "a snapshot ends too early"});
    return frame.last;
}

std::uint64_t SnapshotReader::specs() const { return state_->specs; }
Bytes SnapshotReader::takeBytes() { return std::move(state_->raw); }

class SnapshotDecoder::Records final : public SnapshotRecords {
public:
    Result<void> spec(NodeId node, NodeId parent, std::uint64_t order, SpecKind kind,
                      std::string_view name) override {
        node_ = node;
        return malformedUnless(builder.addSpec(node, parent, order, kind, name));
    }
    Result<void> field(std::string_view name, FieldValue value) override {
        return malformedUnless(builder.addField(node_, name, std::move(value)));
    }

    LayerDoc::Builder builder;

private:
    static Result<void> malformedUnless(Result<void> added) {
        if (!added) return fail(ErrorCode::MalformedFrame, added.error().message);
        return added;
    }

    NodeId node_ = 0;
};

SnapshotDecoder::SnapshotDecoder() : records_(std::make_unique<Records>()), reader_(*records_) {}
SnapshotDecoder::~SnapshotDecoder() = default;
LayerDoc SnapshotDecoder::take() { return records_->builder.finish(); }

}  // namespace usdlive
