// Fuzzes the messages of a peer: splits them into frames, decodes these, and decodes their content.
#include "usdlive/common/protocol/Frame.h"

#include <algorithm>

#include "Fuzz.h"
#include "session/MessageReader.h"
#include "unit/common/protocol/SampleFrames.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/CompactFrame.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/FrameParts.h"
#include "usdlive/common/protocol/Snapshot.h"

using namespace usdlive;

namespace {

void look(const ControlFrame& frame) { (void)decodeControl(frame.json); }
void look(const SnapshotFrame& frame) {
    SnapshotDecoder decoder;
    const auto last = decoder.add(frame);
    if (last && *last) (void)decoder.take();
}
void look(const BlobFrame& frame) { (void)inflate(frame.data, frame.rawBytes, kChunkBytes); }
void look(const auto&) {}

}  // namespace

namespace usdlive {
namespace {

// The reader returns nothing for a part of a commit that is not its last (FR8), and for names
// (FR10).
bool hasPart(ByteView message) {
    const auto frames = splitMessage(message);
    return frames && std::ranges::any_of(*frames, [](ByteView bytes) {
               if (isCompact(bytes)) return true;
               const auto frame = decodeFrame(bytes);
               const auto* commit = frame ? std::get_if<CommitFrame>(&*frame) : nullptr;
               return commit && commit->more;
           });
}

std::vector<Bytes> partsOf(const auto& whole) {
    std::vector<Bytes> parts;
    for (PartsAt at; !at.isEnd;) parts.push_back(encodePart(whole, at, 600));
    return parts;
}

/// Decodes the compact frames of a message. Each is encoded again, with other numbers, and has the
/// same content.
void readCompact(const std::vector<ByteView>& message) {
    CompactReader reader, again;
    NameNumbers numbers;
    KnownNames known;
    const auto check = [&](const CompactContent& content,
                           const std::optional<CompactFrame>& frame) {
        if (!frame) return;  // too large without the numbers
        const auto withoutLength = [](const Bytes& bytes) { return ByteView(bytes).subspan(4); };
        if (const SharedBytes names = known.introduce(*frame))
            fuzz::require(again.read(withoutLength(*names)).has_value(), "names are read");
        const auto same = again.read(withoutLength(*frame->bytes));
        fuzz::require(same && *same == content, "decoding and encoding returns the same content");
    };
    for (const ByteView bytes : message) {
        if (!isCompact(bytes)) continue;
        const auto content = reader.read(bytes);
        if (!content) return;
        if (const auto* submit = std::get_if<SubmitFrame>(&*content))
            check(*content, encodeCompact(submit->transaction, numbers));
        if (const auto* preview = std::get_if<PreviewFrame>(&*content))
            check(*content, encodeCompact(*preview, numbers));
        if (const auto* commit = std::get_if<CompactCommit>(&*content))
            check(*content, encodeCompact(*commit, numbers));
    }
}

/// Messages of compact frames, with the names that they need.
std::vector<Bytes> compactSeeds() {
    NameNumbers numbers;
    KnownNames known;
    std::vector<Bytes> all;
    Bytes together;
    const auto add = [&](const std::optional<CompactFrame>& frame) {
        Bytes message;
        KnownNames none;
        if (const SharedBytes names = none.introduce(*frame)) message = *names;
        appendBytes(message, *frame->bytes);
        all.push_back(message);
        if (const SharedBytes names = known.introduce(*frame)) appendBytes(together, *names);
        appendBytes(together, *frame->bytes);
    };
    for (int time = 0; time < 3; ++time) {
        for (const Edit& edit : everyKindOfEdit())
            add(encodeCompact(Transaction{{{}, 4}, 17, 5, {edit}}, numbers));
        add(encodeCompact(CompactCommit{sampleCommit(), {}}, numbers));
        add(encodeCompact(PreviewFrame{{"someone"}, 3, 17, everyKindOfEdit()}, numbers));
    }
    all.push_back(encodeAcceptance({9, 3, 4, 1'700'000'000'123, {}, {}}));
    all.push_back(together);
    return all;
}

}  // namespace
}  // namespace usdlive

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    client::MessageReader reader;
    for (int twice = 0; twice < 2; ++twice)
        fuzz::require(!reader.read({data, size}).frames.empty() || hasPart({data, size}),
                      "a message is not empty");
    const auto message = splitMessage({data, size});
    if (!message) return 0;
    readCompact(*message);
    for (const ByteView bytes : *message) {
        const auto frame = decodeFrame(bytes);
        (void)importStub(bytes, {});
        if (!frame) continue;
        const Bytes written = encodeFrame(*frame);
        const auto again = decodeFrame(ByteView(written).subspan(sizeof(std::uint32_t)));
        fuzz::require(again && *again == *frame, "decoding and encoding returns the same frame");
        std::visit([](const auto& content) { look(content); }, *frame);
    }
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    for (const Frame& frame : sampleFrames()) all.push_back(encodeFrame(frame));
    // Uses each kind of edit alone, so that a seed is small.
    for (const Edit& edit : everyKindOfEdit())
        all.push_back(encodeFrame(SubmitFrame{{{{"client"}, 4}, 17, 5, {edit}}}));
    for (const Bytes& part : partsOf(sampleCommit())) all.push_back(part);
    for (const Bytes& part : partsOf(Transaction{{{"client"}, 4}, 17, 5, everyKindOfEdit()}))
        all.push_back(part);
    Bytes together;
    for (const Bytes& part : partsOf(sampleCommit())) appendBytes(together, part);
    all.push_back(together);
    for (Bytes& message : compactSeeds()) all.push_back(std::move(message));
    return all;
}
