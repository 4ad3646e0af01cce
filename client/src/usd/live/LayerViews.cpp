// Applies the changes of live layers to their views.
#include "usd/live/LayerViews.h"

#include <pxr/usd/sdf/changeBlock.h>

namespace usdlive::client {

void LayerViews::add(const LayerId& id, const pxr::SdfLayerRefPtr& view) {
    const auto [entry, isNew] = views_.try_emplace(view->GetUniqueIdentifier());
    if (!isNew) return;
    const pxr::SdfChangeBlock block;
    view->SetPermissionToEdit(true);
    view->Clear();  // removes the content of a placeholder
    view->SetPermissionToEdit(false);
    entry->second = {id, view, std::make_unique<usd::SdfLayerStore>(view, blobs_, nullptr), {}, {}};
    follow(entry->second);
}

void LayerViews::follow() {
    std::erase_if(views_, [this](const auto& entry) {
        return !live_.find(entry.second.id) && entry.second.layer->IsUnique();
    });
    for (auto& [key, view] : views_) follow(view);
}

void LayerViews::follow(View& view) const {
    const LiveLayer* const from = live_.find(view.id);
    const LayerDoc* const content = from && !from->waitsForBlobs() ? from->content() : nullptr;
    if (!content) return;
    const LayerDoc shown = view.shown.value_or(LayerDoc());
    usd::SdfLayerStore::Block block;
    for (const auto& [path, action] : difference(shown, *content))
        if (!view.shown || !view.apart.take(path, action))
            static_cast<void>(view.store->apply(path, action, block));
    view.shown = *content;
}

bool LayerViews::applyApart() {
    for (auto& [key, view] : views_) {
        if (view.apart.isEmpty()) continue;
        usd::SdfLayerStore::Block block;
        for (const EditAction& edit : view.apart.next())
            static_cast<void>(view.store->apply("/", edit, block));
        return true;
    }
    return false;
}

}  // namespace usdlive::client
