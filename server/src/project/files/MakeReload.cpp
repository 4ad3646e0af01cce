// Compares a layer with its file, node by node.
#include "project/Project.h"
#include "usdlive/common/layer/MatchedSpecs.h"

namespace usdlive::server {

namespace {

std::vector<Edit> editsBetween(const LayerId& layer, const LayerDoc& present,
                               const LayerDoc& content) {
    std::vector<Edit> edits;
    for (auto& [path, action] : difference(present, content))
        edits.push_back({layer, {std::move(path), {}}, std::move(action)});
    return edits;
}

}  // namespace

ReloadedLayer makeReload(const LayerId& layer, const LayerDoc& present, const LayerDoc& content,
                         const FileStamp& file) {
    ReloadedLayer reloaded{{}, matchedSpecs(present, content), file};
    reloaded.edits = editsBetween(layer, present, reloaded.doc);
    return reloaded;
}

}  // namespace usdlive::server
