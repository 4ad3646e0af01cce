// Encodes and decodes the snapshots of layers.
#include "storage/LayerSnapshots.h"

#include <fcntl.h>

#include <algorithm>

#include "storage/Files.h"
#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::server {

Bytes encodeSnapshot(const LayerSnapshot& snapshot) {
    Bytes bytes;
    appendNumber<Revision>(bytes, snapshot.revision);
    appendBytes(bytes, snapshot.hash.bytes);
    SnapshotEncoder encoder(snapshot.doc, 0);
    while (const auto chunk = encoder.next()) appendBytes(bytes, encodeFrame(*chunk));
    return bytes;
}

std::optional<Revision> snapshotRevision(const std::filesystem::path& path) {
    const auto file = openFile(path, O_RDONLY);
    const auto begin = file ? readAt(*file, 0, sizeof(Revision), path) : Result<Bytes>();
    if (!begin || begin->size() < sizeof(Revision)) return std::nullopt;
    return ByteReader(*begin).u64();
}

std::optional<LayerSnapshot> decodeSnapshot(ByteView bytes) {
    ByteReader in(bytes);
    LayerSnapshot snapshot;
    snapshot.revision = in.u64();
    const ByteView hash = in.take(snapshot.hash.bytes.size());
    if (in.failed()) return std::nullopt;
    std::ranges::copy(hash, snapshot.hash.bytes.begin());
    const auto frames = splitMessage(in.take(in.left()));
    if (!frames) return std::nullopt;
    SnapshotDecoder decoder;
    bool whole = false;
    for (const ByteView frame : *frames) {
        const auto decoded = decodeFrame(frame);
        const auto* chunk = decoded ? std::get_if<SnapshotFrame>(&*decoded) : nullptr;
        if (!chunk || whole) return std::nullopt;
        const auto last = decoder.add(*chunk);
        if (!last) return std::nullopt;
        whole = *last;
    }
    if (!whole) return std::nullopt;
    snapshot.doc = decoder.take();
    return snapshot;
}

}  // namespace usdlive::server
