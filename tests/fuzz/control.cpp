// Fuzzes the decoder of control messages with any text, JSON or not.
#include "usdlive/common/protocol/Control.h"

#include "Fuzz.h"

using namespace usdlive;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto message = decodeControl(asText({data, size}));
    if (!message) return 0;
    const auto again = decodeControl(encodeControl(*message));
    fuzz::require(again && *again == *message, "decoding and encoding returns the same message");
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    const Hash hash = sha256(asBytes("x"));
    const LayerId layer{"shot/a.usda"};
    std::vector<Bytes> all;
    for (const ControlMessage& message : std::vector<ControlMessage>{
             Hello{1,
                   1,
                   {"log"},
                   {"client"},
                   {"user"},
                   "app",
                   {},
                   Hello::Resume{3, 7, hash},
                   {{{"a.usda"}}}},
             Welcome{1, {"history"}, "film", 3, 7, hash, true, {{layer}}, 1 << 26, 1 << 30},
             LayerList{{layer}, {{"b.usda"}}},
             ShowToken{"0123"},
             KeepLayers{{layer}},
             ProjectLayers{{{layer}}},
             OpenLayer{1, layer, 5},
             LayerOpened{1, layer, 7, 100},
             CloseLayer{layer},
             RequestBlob{hash, 4096},
             BlobStored{hash},
             AlreadyCommitted{4, 7},
             SaveLayers{2, {layer}, true},
             ReloadLayers{4, {layer}},
             UploadFile{4, "tex/a.png", hash, 9, true},
             FileUploaded{4, "tex/a.png", true},
             CreateCheckpoint{5, "lunch"},
             ListCheckpoints{6},
             CompactHistory{6, 30},
             RequestStorage{6},
             CheckpointCreated{5, {"lunch", 7, {"ada"}, 9}},
             Checkpoints{6, {{"lunch", 7, {"ada"}, 9}}},
             HistoryCompacted{6, 7, 7, 90, 3, "nobody"},
             Storage{6, 9, 7, 8, 1, 2, 3, 4, 5, 6, 7, 8, {{{"a.usda"}, 1, 2, 3, 4, 5, 6}}},
             LayersReloaded{4, 8, {layer}, {{{"b.usdc"}, "layerUnreadable", "no text"}}},
             LayersSaved{2, 7, {layer}, {{{"b.usdc"}, "saveFailed", "no room"}}},
             RequestLog{3, 1, 0},
             LogBegin{3},
             LogEnd{3},
             ErrorMessage{"blobNotFound", "Zoë's \"texture\"", false, 1, hash}})
        all.push_back(copyOf(asBytes(encodeControl(message))));
    return all;
}
