// Compares a layer with its file, node by node.
#include <string>
#include <unordered_map>

#include "usdlive/server/project/Project.h"

namespace usdlive::server {

namespace {

/// Returns `content` with the node ids of `present` for the specs that both have.
LayerDoc matched(const LayerDoc& present, const LayerDoc& content) {
    struct Spec {
        NodeId node;
        SpecKind kind;
    };
    std::unordered_map<std::string, Spec> known;
    present.visit([&](const LayerDoc::SpecView& spec) {
        known.emplace(spec.path, Spec{spec.node, spec.kind});
    });
    LayerDoc::Builder builder;
    std::unordered_map<NodeId, NodeId> ids{{0, 0}};
    NodeId next = present.nextId();
    content.visit([&](const LayerDoc::SpecView& spec) {
        const auto same = known.find(std::string(spec.path));
        const bool isKnown = same != known.end() && same->second.kind == spec.kind;
        const NodeId node = isKnown ? same->second.node : next++;
        ids.emplace(spec.node, node);
        (void)builder.addSpec(node, ids.at(spec.parent), spec.order, spec.kind, spec.name);
        for (const auto& [name, value] : *spec.fields) (void)builder.addField(node, name, value);
    });
    return builder.finish();
}

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
    ReloadedLayer reloaded{{}, matched(present, content), file};
    reloaded.edits = editsBetween(layer, present, reloaded.doc);
    return reloaded;
}

}  // namespace usdlive::server
