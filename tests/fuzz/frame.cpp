// Fuzzes the messages of a peer: splits them into frames, decodes these, and decodes their content.
#include "usdlive/common/protocol/Frame.h"

#include <algorithm>

#include "Fuzz.h"
#include "session/MessageReader.h"
#include "unit/common/protocol/SampleFrames.h"
#include "usdlive/common/core/ByteStream.h"
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

// The reader returns nothing for a part of a commit that is not its last (FR8).
bool hasPart(ByteView message) {
    const auto frames = splitMessage(message);
    return frames && std::ranges::any_of(*frames, [](ByteView bytes) {
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

}  // namespace
}  // namespace usdlive

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    client::MessageReader reader;
    for (int twice = 0; twice < 2; ++twice)
        fuzz::require(!reader.read({data, size}).frames.empty() || hasPart({data, size}),
                      "a message is not empty");
    const auto message = splitMessage({data, size});
    if (!message) return 0;
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
    return all;
}
