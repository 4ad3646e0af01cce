// Compares the contents of a layer that have no common history, spec by spec.
#include "usdlive/common/layer/MatchedSpecs.h"

#include <string>
#include <unordered_map>

namespace usdlive {

LayerDoc matchedSpecs(const LayerDoc& present, const LayerDoc& content) {
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

}  // namespace usdlive
