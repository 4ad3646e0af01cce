// Finds the local layers of a stage and the places with opinions about a prim, as Pcp composes
// them.
#include "usd/layers/LocalStack.h"

#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/node.h>
#include <pxr/usd/pcp/primIndex.h>

#include <utility>

#include "usd/layers/OmniLayerData.h"

namespace usdlive::layers {

using pxr::SdfPath;

namespace {

// Returns true if the node is reached from the prim's own node by variants only.
bool isLocal(const pxr::PcpNodeRef& node) {
    for (auto at = node; at.GetArcType() != pxr::PcpArcTypeRoot; at = at.GetParentNode())
        if (at.GetArcType() != pxr::PcpArcTypeVariant) return false;
    return true;
}

}  // namespace

LocalStack::LocalStack(const StageHost& host) : host_(host) {}

void LocalStack::follow(const pxr::SdfLayerChangeListVec& changes) {
    if (own_) own_->follow(changes);
}

void LocalStack::mutenessChanged() {
    if (own_) own_->setMuted(host_.mutedLayers());
}

stage::Composition& LocalStack::composition() {
    if (auto* hosts = host_.composition()) return *hosts;
    if (!own_)
        own_ = std::make_unique<stage::Composition>(host_.rootLayer(), host_.sessionLayer(),
                                                    host_.mutedLayers(),
                                                    stage::Composition::Payloads::None);
    return *own_;
}

void LocalStack::listLayers(const pxr::PcpLayerStack& stack) {
    const std::size_t ofSession = stack.GetSessionLayers().size();
    layers_.clear();
    for (const auto& layer : stack.GetLayers()) {
        const auto* offset = stack.GetLayerOffsetForLayer(layers_.size());
        layers_.push_back({layer, offset ? *offset : pxr::SdfLayerOffset(), false});
        layers_.back().ofSession = layers_.size() <= ofSession;
    }
}

const std::vector<LocalStack::Layer>& LocalStack::layers() {
    auto& composed = composition();
    if (std::exchange(listed_, composed.localRevision()) != composed.localRevision())
        listLayers(composed.localLayers());
    return layers_;
}

const LocalStack::Layer* LocalStack::find(const pxr::SdfLayerHandle& layer) {
    for (const auto& one : layers())
        if (one.layer == layer) return &one;
    return nullptr;
}

LayerResult<LocalStack::Layer> LocalStack::named(const std::string& identifier) {
    const auto wanted = absoluteFrom(host_.rootLayer(), identifier);
    for (const auto& one : layers())
        if (one.layer->GetIdentifier() == identifier || one.layer->GetIdentifier() == wanted)
            return one;
    return fail(LayerErrorType::NotFound, "the stage has no local layer '" + identifier + "'");
}

double LocalStack::timeCodesPerSecond() {
    return composition().localLayers().GetTimeCodesPerSecond();
}

std::uint64_t LocalStack::revision() { return composition().localRevision(); }

std::vector<LocalStack::Site> LocalStack::sites(const SdfPath& prim) {
    std::vector<Site> sites;
    const auto* index = composition().primIndex(prim);
    if (!index) return sites;
    for (const auto& node : index->GetNodeRange()) {
        if (!node.CanContributeSpecs() || !node.HasSpecs()) continue;
        sites.push_back({node.GetPath(), isLocal(node) ? nullptr : &*node.GetLayerStack()});
    }
    return sites;
}

}  // namespace usdlive::layers
