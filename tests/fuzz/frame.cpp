// Messages as they come from a peer: split into frames, decoded, and what is inside of those.
#include "usdlive/common/protocol/Frame.h"

#include "Fuzz.h"
#include "unit/common/protocol/SampleFrames.h"
#include "usdlive/client/session/MessageReader.h"
#include "usdlive/common/protocol/Control.h"
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

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    client::MessageReader reader;
    for (int twice = 0; twice < 2; ++twice)
        fuzz::require(!reader.read({data, size}).frames.empty(), "a message says something");
    const auto message = splitMessage({data, size});
    if (!message) return 0;
    for (const ByteView bytes : *message) {
        const auto frame = decodeFrame(bytes);
        (void)importStub(bytes, {});
        if (!frame) continue;
        const Bytes written = encodeFrame(*frame);
        const auto again = decodeFrame(ByteView(written).subspan(sizeof(std::uint32_t)));
        fuzz::require(again && *again == *frame, "a frame comes back as it was");
        std::visit([](const auto& content) { look(content); }, *frame);
    }
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    for (const Frame& frame : sampleFrames()) all.push_back(encodeFrame(frame));
    // Each kind of edit alone, so that a seed is small.
    for (const Edit& edit : everyKindOfEdit())
        all.push_back(encodeFrame(SubmitFrame{{{{"client"}, 4}, 17, 5, {edit}}}));
    return all;
}
