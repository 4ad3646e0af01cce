// Encodes each list and each change once for all sessions.
#include "project/layers/LayerLists.h"

#include <memory>

#include "project/SharedFrame.h"
#include "project/sessions/UpdateFrames.h"

namespace usdlive::server {

namespace {

SharedBytes encodeLists(const std::vector<LayerId>& added, const std::vector<LayerId>& removed) {
    Bytes frames;
    appendUpdates(frames, std::span(removed),
                  [](auto some) { return LayerList{{}, {some.begin(), some.end()}}; });
    appendUpdates(frames, std::span(added),
                  [](auto some) { return LayerList{{some.begin(), some.end()}, {}}; });
    return std::make_shared<const Bytes>(std::move(frames));
}

}  // namespace

void LayerLists::sendAllTo(const Session& session) {
    if (!session.features.contains(kLayerListFeature)) return;
    if (!all_) all_ = encodeLists(layers_->all(), {});
    if (!all_->empty()) outbox_->send(session.id, all_);
}

void LayerLists::changed(const std::vector<LayerId>& added, const std::vector<LayerId>& removed) {
    if (added.empty() && removed.empty()) return;
    all_ = nullptr;
    const SharedBytes changes = encodeLists(added, removed);
    SharedBytes whole;
    for (const auto& [id, session] : sessions_->all()) {
        if (!session.isGreeted()) continue;
        const bool readsChanges = session.features.contains(kLayerListFeature);
        if (!readsChanges && !whole) whole = sharedFrame(ProjectLayers{layers_->infos()});
        outbox_->send(id, readsChanges ? changes : whole);
    }
}

}  // namespace usdlive::server
