// The live layers of a client connection.
#include "usdlive/client/usd/layers/LiveLayers.h"

#include "usdlive/client/usd/Client.h"

namespace usdlive::layers {

UserName ClientLayers::user() const { return {client_.user()}; }

std::optional<LiveState> ClientLayers::state(const pxr::SdfLayerHandle& layer) const {
    const auto id = layer ? client_.layerId(layer) : std::nullopt;
    if (!id) return std::nullopt;
    LiveState live;
    live.pending = client_.pendingTransactions() > 0;
    const auto& states = client_.layerStates();
    const auto found = states.find(*id);
    if (found == states.end()) return live;
    live.dirty = found->second.dirty;
    live.lockHolder = found->second.holder;
    live.lockedByOther = found->second.locked && !live.lockHolder.empty() &&
                         live.lockHolder != user() && !client_.isAdministrator();
    live.outdated = found->second.outdated;
    live.writable = found->second.writable;
    live.owner = found->second.owner;
    live.saved = found->second.saved;
    return live;
}

bool ClientLayers::setLocked(const pxr::SdfLayerHandle& layer, bool locked,
                             const std::function<void()>& alongside) {
    const auto id = client_.layerId(layer);
    return id && client_.setLocked(*id, locked, alongside).has_value();
}

bool ClientLayers::isApplying() const { return client_.isApplying(); }

void ClientLayers::withoutWaiting(const std::function<void()>& compose) {
    client_.withoutWaiting(compose);
}

void ClientLayers::reload(const pxr::SdfLayerHandle& layer) {
    if (const auto id = client_.layerId(layer)) client_.reload({*id});
}

}  // namespace usdlive::layers
