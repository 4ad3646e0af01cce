// Finds the layers that a stage uses.
#include "usd/layers/StageLayers.h"

#include <utility>

#include "usd/layers/LayerMuteness.h"
#include "usd/layers/LayersContext.h"
#include "usdlive/client/usd/layers/LayerUtils.h"

namespace usdlive::layers {

StageLayers::StageLayers(LayersContext& context, const LayerMuteness& muteness, Found found)
    : context_(context), muteness_(muteness), found_(std::move(found)) {}

bool StageLayers::isRoot(const std::string& id) const {
    return id == context_.host.rootLayer()->GetIdentifier();
}

bool StageLayers::isSession(const std::string& id) const {
    const auto session = context_.host.sessionLayer();
    return session && id == session->GetIdentifier();
}

bool StageLayers::isCurrent() const {
    return structureKnown_ && mutenessKnown_ == muteness_.revision();
}

void StageLayers::keepCurrent() {
    if (!isCurrent()) learn();
}

const StageLayers::Layer* StageLayers::find(const std::string& id) {
    keepCurrent();
    auto found = layers_.find(id);
    if (found == layers_.end()) found = layers_.find(LayerUtils::normalizeUrl(id));
    return found == layers_.end() ? nullptr : &found->second;
}

const std::string& StageLayers::idOf(const std::string& spelling) const {
    if (layers_.contains(spelling)) return spelling;
    const auto found = layers_.find(LayerUtils::normalizeUrl(spelling));
    return found == layers_.end() ? spelling : found->second.id;
}

const StageLayers::Layer* StageLayers::findUsed(const std::string& id) {
    if (!usedKnown_) {
        usedKnown_ = true;
        std::set<std::string> now;
        for (const auto& layer : context_.host.usedLayers())
            if (layer && layer->GetIdentifier() != hidden_) now.insert(layer->GetIdentifier());
        if (now != used_) {
            context_.events.push(LayerEventType::UsedLayersChanged);
            learn();
        }
    }
    return find(id);
}

const StageLayers::Layer* StageLayers::known(const std::string& id) const {
    const auto found = layers_.find(id);
    return found == layers_.end() ? nullptr : &found->second;
}

std::optional<LayerError> StageLayers::whyUnknown(const std::string& id) {
    if (find(id)) return std::nullopt;
    if (id.empty()) return LayerError{LayerErrorType::InvalidParam, "no layer is named"};
    return LayerError{LayerErrorType::NotFound, "the stage does not use a layer " + id};
}

const std::vector<std::string>& StageLayers::local() {
    keepCurrent();
    return order_;
}

const std::vector<std::string>& StageLayers::missing() {
    keepCurrent();
    return missing_;
}

const std::set<std::string>& StageLayers::used() {
    keepCurrent();
    return used_;
}

void StageLayers::hide(const std::string& identifier) {
    hidden_ = identifier;
    structureChanged();
}

void StageLayers::check() {
    const auto before = used_;
    learn();
    if (before != used_) context_.events.push(LayerEventType::UsedLayersChanged);
}

void StageLayers::addLocal(const std::string& id, const pxr::SdfLayerHandle& layer, bool session) {
    layers_[id] = {.id = id, .layer = layer, .local = true, .session = session};
    order_.push_back(id);
}

void StageLayers::learnSublayers(const pxr::SdfLayerHandle& layer, bool session,
                                 std::set<std::string>& visited) {
    LayerUtils::iterateSublayers(
        layer, [&](const auto&, int, const std::string& id, const pxr::SdfLayerHandle& sublayer) {
            if (id == hidden_ || !visited.insert(id).second) return true;
            if (!sublayer && !muteness_.isMuted(id))
                missing_.push_back(id);
            else
                addLocal(id, sublayer, session);
            return true;
        });
}

void StageLayers::learnLocal() {
    std::set<std::string> visited;
    for (const auto& top : {context_.host.rootLayer(), context_.host.sessionLayer()}) {
        if (!top) continue;
        const bool session = top == context_.host.sessionLayer();
        if (visited.insert(top->GetIdentifier()).second)
            addLocal(top->GetIdentifier(), top, session);
        learnSublayers(top, session, visited);
    }
}

void StageLayers::learn() {
    structureKnown_ = usedKnown_ = true;
    mutenessKnown_ = muteness_.revision();
    const auto before = std::exchange(layers_, {});
    order_.clear();
    missing_.clear();
    used_.clear();
    learnLocal();
    for (const auto& layer : context_.host.usedLayers()) {
        if (!layer || layer->GetIdentifier() == hidden_) continue;
        const std::string& id = layer->GetIdentifier();
        auto& known = layers_[id];
        known.id = id;
        known.layer = layer;
        known.used = true;
        used_.insert(id);
    }
    Difference difference;
    for (const auto& [id, layer] : layers_)
        if (!before.contains(id)) difference.added.push_back(&layer);
    for (const auto& [id, layer] : before)
        if (!layers_.contains(id)) difference.removed.push_back(id);
    found_(difference);
}

}  // namespace usdlive::layers
