#include "usdlive/server/app/LayerHistory.h"

#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

namespace {

constexpr std::size_t kLengthBytes = 4;

Error damaged(Revision revision, const std::string& why) {
    return Error{ErrorCode::StorageCorrupt,
                 "commit " + std::to_string(revision) + " cannot be applied again: " + why};
}

Result<Commit> decodeCommit(const StoredCommit& stored) {
    auto frame = decodeFrame(ByteView(*stored.frame).subspan(kLengthBytes));
    if (!frame) return tl::unexpected(damaged(stored.revision, frame.error().message));
    auto* commit = std::get_if<CommitFrame>(&*frame);
    if (!commit) return tl::unexpected(damaged(stored.revision, "it is none"));
    return std::move(commit->commit);
}

Result<void> apply(LayerDoc& doc, const LayerId& layer, const Commit& commit) {
    for (const Edit& edit : commit.edits) {
        if (edit.layer != layer) continue;
        if (const auto applied = doc.apply(edit.address.path, edit.action); !applied)
            return tl::unexpected(damaged(commit.revision, applied.error().message));
    }
    return {};
}

}  // namespace

Result<LayerDoc> layerAt(const CommitStore& store, const LayerId& layer, Revision revision) {
    LayerDoc doc;
    bool found = false;
    Result<void> applied;
    const auto read = store.read(1, store.head().revision, [&](const StoredCommit& stored) {
        if (stored.revision > revision && found) return false;
        const auto commit = decodeCommit(stored);
        if (!commit) {
            applied = tl::unexpected(commit.error());
            return false;
        }
        const bool imports = commit->imported == layer;
        if (stored.revision > revision && !imports) return true;
        found = found || imports;
        applied = apply(doc, layer, *commit);
        return bool(applied);
    });
    if (!read) return tl::unexpected(read.error());
    if (!applied) return tl::unexpected(applied.error());
    if (!found) return fail(ErrorCode::LayerNotFound, "nobody has opened " + layer.value + " yet");
    return doc;
}

}  // namespace usdlive::server
