// Reads and edits the layers that Kit mutes for everybody, in
// `customLayerData:omni_layer:muteness`.
#include "usdlive/common/layer/GlobalMuteness.h"

#include <filesystem>
#include <string>

#include "OmniLayer.h"

namespace usdlive {

namespace {

namespace fs = std::filesystem;

using omniLayer::layerAt;

const std::string kMuteness = "muteness";

const Dictionary* mutenessOf(const LayerDoc& doc) {
    const Dictionary* group = omniLayer::groupOf(doc);
    return group ? omniLayer::dictionaryAt(*group, kMuteness) : nullptr;
}

std::string keyOf(const LayerId& root, const LayerId& layer) {
    const fs::path folder = fs::path(root.value).parent_path();
    const std::string path =
        fs::path(layer.value).lexically_relative(folder.empty() ? "." : folder).generic_string();
    return path.starts_with("../") ? path : "./" + path;
}

}  // namespace

std::set<LayerId> globallyMuted(const LayerId& root, const LayerDoc& doc) {
    std::set<LayerId> muted;
    const Dictionary* muteness = mutenessOf(doc);
    if (!muteness) return muted;
    for (const auto& [key, entry] : muteness->entries) {
        const auto* value = std::get_if<Value>(&entry);
        if (!value || *value != boolValue(true)) continue;
        if (auto layer = layerAt(root, key)) muted.insert(std::move(*layer));
    }
    return muted;
}

bool isMuteEdit(const EditAction& action) { return omniLayer::isOnlyIn(action, {kMuteness}); }

std::vector<EditAction> globalMuteEdits(const LayerId& root, const LayerDoc& doc,
                                        const LayerId& layer, bool muted) {
    std::vector<EditAction> edits;
    bool found = false;
    if (const Dictionary* muteness = mutenessOf(doc))
        for (const auto& [key, entry] : muteness->entries) {
            if (layerAt(root, key) != layer) continue;
            found = true;
            if (entry != Dictionary::Entry(boolValue(muted)))
                edits.push_back(omniLayer::keyEdit({kMuteness, key}, boolValue(muted)));
        }
    if (!found && muted)
        edits.push_back(omniLayer::keyEdit({kMuteness, keyOf(root, layer)}, boolValue(true)));
    return edits;
}

}  // namespace usdlive
