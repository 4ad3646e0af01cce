// Keeps the muteness of a stage's layers and its flags.
#include "usd/layers/LayerMuteness.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"

namespace usdlive::layers {

namespace {

const std::string kMuteness = "muteness";

}  // namespace

LayerMuteness::LayerMuteness(LayersContext& context, IsLocal isLocal)
    : context_(context), isLocal_(std::move(isLocal)) {
    const auto muted = context_.host.mutedLayers();
    stage_ = local_ = {muted.begin(), muted.end()};
    learnFlags();
}

void LayerMuteness::learnFlags() {
    global_.clear();
    for (const auto& [id, muted] : layerFlags(context_.host.rootLayer(), kMuteness))
        if (muted) global_.insert(id);
    for (const auto& [id, muted] : unwritten_) {
        if (muted)
            global_.insert(id);
        else
            global_.erase(id);
    }
}

void LayerMuteness::notify(std::vector<std::string> changed) {
    context_.events.push(LayerEventType::MutenessStateChanged, std::move(changed));
    context_.stack.mutenessChanged();
    ++revision_;
}

void LayerMuteness::apply(const std::set<std::string>& wanted) {
    std::vector<std::string> mute, unmute;
    std::ranges::set_difference(wanted, stage_, std::back_inserter(mute));
    std::ranges::set_difference(stage_, wanted, std::back_inserter(unmute));
    if (mute.empty() && unmute.empty()) return;
    applying_ = true;
    const auto change = [&] { context_.host.muteAndUnmute(mute, unmute); };
    if (context_.live)
        context_.live->withoutWaiting(change);
    else
        change();
    applying_ = false;
    const auto now = context_.host.mutedLayers();
    stage_ = {now.begin(), now.end()};
    mute.insert(mute.end(), unmute.begin(), unmute.end());
    notify(std::move(mute));
}

void LayerMuteness::setScope(bool global) {
    if (globalScope_ == global) return;
    follow();
    globalScope_ = global;
    context_.events.push(LayerEventType::MutenessScopeChanged);
    apply(globalScope_ ? global_ : local_);
}

LayerResult<void> LayerMuteness::setGlobally(const std::string& id, bool muted) {
    if (!setLayerFlags(context_.host.rootLayer(), kMuteness, {{id, muted}}))
        return fail(LayerErrorType::ReadOnly,
                    "the root layer, which stores muteness, accepts no edits");
    learnFlags();
    if (globalScope_)
        apply(global_);
    else
        context_.events.push(LayerEventType::MutenessStateChanged, {id});
    return {};
}

void LayerMuteness::stageChanged() {
    if (applying_) return;
    const auto muted = context_.host.mutedLayers();
    const std::set<std::string> now(muted.begin(), muted.end());
    if (now == stage_) return;
    std::vector<std::string> changed;
    std::ranges::set_symmetric_difference(stage_, now, std::back_inserter(changed));
    stage_ = now;
    if (globalScope_)
        for (const auto& id : changed) unwritten_[id] = now.contains(id);
    (globalScope_ ? global_ : local_) = now;
    notify(std::move(changed));
}

void LayerMuteness::flagsChanged() {
    const auto before = global_;
    learnFlags();
    std::vector<std::string> changed;
    std::ranges::set_symmetric_difference(before, global_, std::back_inserter(changed));
    if (changed.empty()) return;
    context_.events.push(LayerEventType::MutenessStateChanged, std::move(changed));
    stageDue_ = true;
}

void LayerMuteness::follow() {
    if (std::exchange(stageDue_, false) && globalScope_) apply(global_);
    stageChanged();
    if (!unwritten_.empty()) writeFlags();
}

void LayerMuteness::writeFlags() {
    const auto root = context_.host.rootLayer();
    auto flags = std::exchange(unwritten_, {});
    const auto written = layerFlags(root, kMuteness);
    // A layer that was removed from the stack is unmuted, and its flag is removed already.
    std::erase_if(flags, [&](const auto& flag) {
        return !flag.second && !written.contains(flag.first) && !isLocal_(flag.first);
    });
    setLayerFlags(root, kMuteness, flags);
}

}  // namespace usdlive::layers
