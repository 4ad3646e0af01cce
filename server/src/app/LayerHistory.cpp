#include "usdlive/server/app/LayerHistory.h"

#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

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
        applied = replay(doc, layer, *commit);
        return bool(applied);
    });
    if (!read) return tl::unexpected(read.error());
    if (!applied) return tl::unexpected(applied.error());
    if (!found) return fail(ErrorCode::LayerNotFound, "nobody has opened " + layer.value + " yet");
    return doc;
}

}  // namespace usdlive::server
