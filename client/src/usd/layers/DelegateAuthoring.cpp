// Keeps the delegate layer of auto authoring and distributes its edits.
#include "usd/layers/DelegateAuthoring.h"

#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/schema.h>

#include <utility>

#include "usd/layers/Distribution.h"
#include "usd/layers/LayersContext.h"

namespace usdlive::layers {

using pxr::SdfLayerHandle;
using pxr::SdfPath;

namespace {

const std::string kTag = "__DELTA_LAYER__";

}  // namespace

DelegateAuthoring::DelegateAuthoring(LayersContext& context, DistributionRules& rules)
    : context_(context), rules_(rules) {}

DelegateAuthoring::~DelegateAuthoring() {
    if (!delegate_) return;
    // The stage may outlive this object and must not edit a layer that nobody distributes.
    removeFromSession();
    context_.host.setEditTarget(context_.host.rootLayer());
}

bool DelegateAuthoring::isDelegate(const std::string& identifier) {
    return identifier.find(kTag) != std::string::npos;
}

std::string DelegateAuthoring::defaultLayer() {
    if (!default_ || !context_.stack.find(default_)) default_ = context_.host.rootLayer();
    return default_->GetIdentifier();
}

LayerResult<void> DelegateAuthoring::setDefaultLayer(const std::string& identifier) {
    const auto found = context_.stack.named(identifier);
    if (!found) return tl::unexpected(found.error());
    if (found->ofSession)
        return fail(LayerErrorType::InvalidParam,
                    "new specs cannot be created in the session's layer " + identifier);
    if (found->layer->GetIdentifier() == defaultLayer()) return {};
    default_ = found->layer;
    context_.events.push(LayerEventType::DefaultLayerChanged);
    return {};
}

LayerResult<void> DelegateAuthoring::enable() {
    if (delegate_) return {};
    if (!context_.host.sessionLayer())
        return fail(LayerErrorType::InvalidStage,
                    "a stage without a session layer cannot use auto authoring");
    delegate_ = pxr::SdfLayer::CreateAnonymous(kTag);
    writes_ = pxr::TfCreateRefPtr(new DelegateWrites);
    delegate_->SetStateDelegate(writes_);
    suspended_ = false;
    stale_.clear();
    keepInPlace();
    if (delegate() == context_.host.editTarget()) return {};
    disable();
    return fail(LayerErrorType::InvalidStage,
                "the session layer does not accept the delegate as a sublayer");
}

void DelegateAuthoring::disable() {
    if (!delegate_) return;
    context_.host.setEditTarget(pxr::SdfLayer::Find(defaultLayer()));
    removeFromSession();
    delegate_.Reset();
    writes_.Reset();
    stale_.clear();
}

void DelegateAuthoring::keepInPlace() {
    if (!delegate_) return;
    const auto session = context_.host.sessionLayer();
    const std::string& id = delegate_->GetIdentifier();
    if (!session) return;
    const std::vector<std::string> paths = session->GetSubLayerPaths();
    if (paths.empty() || paths[0] != id) {
        const pxr::SdfChangeBlock block;
        removeFromSession();
        session->InsertSubLayerPath(id, 0);
    }
    followTime();
    if (context_.host.editTarget() != delegate()) context_.host.setEditTarget(delegate_);
}

void DelegateAuthoring::removeFromSession() {
    const auto session = context_.host.sessionLayer();
    if (!session) return;
    const std::vector<std::string> paths = session->GetSubLayerPaths();
    for (int i = int(paths.size()) - 1; i >= 0; --i)
        if (paths[std::size_t(i)] == delegate_->GetIdentifier()) session->RemoveSubLayerPath(i);
}

// Gives the delegate the stage's time codes, because a plain layer as edit target does not map
// times.
void DelegateAuthoring::followTime() {
    const double rate = context_.stack.timeCodesPerSecond();
    if (delegate_->GetTimeCodesPerSecond() == rate) return;
    const DelegateWrites::Ignoring ignoring(*writes_);
    delegate_->SetTimeCodesPerSecond(rate);
}

void DelegateAuthoring::layerChanged(const SdfLayerHandle& layer,
                                     const pxr::SdfChangeList& changes) {
    if (!delegate_) return;
    const bool own = layer == delegate();
    for (const auto& [path, entry] : changes.GetEntryList()) {
        const auto& flags = entry.flags;
        if (flags.didReplaceContent && own) {
            writes_->contentReplaced();
        } else if (flags.didReplaceContent) {
            structureChanged_ = true;
        } else if (!own && path != SdfPath::AbsoluteRootPath()) {
            const bool below = flags.didRename || flags.didAddInertPrim ||
                               flags.didAddNonInertPrim || flags.didRemoveInertPrim ||
                               flags.didRemoveNonInertPrim || flags.didRemoveProperty ||
                               flags.didRemovePropertyWithOnlyRequiredFields;
            const SdfPath spec = path.ContainsTargetPath() ? path.GetParentPath() : path;
            auto& stale = stale_[spec];
            stale = stale || below;
            if (flags.didRename) stale_[entry.oldPath] = true;
        }
    }
}

std::vector<RefusedEdit> DelegateAuthoring::update(content::Recorder* recorder) {
    if (!delegate_ || suspended_) return {};
    if (recorder) recorder->forget(delegate_);
    const auto revision = context_.stack.revision();
    if (std::exchange(stackRevision_, revision) != revision) structureChanged_ = true;
    if (writes_->empty() && stale_.empty() && !structureChanged_) return {};
    const auto stale = std::exchange(stale_, {});
    const auto taken = writes_->take();
    const DelegateWrites::Ignoring ignoring(*writes_);
    const SdfLayerHandle target = pxr::SdfLayer::Find(defaultLayer());
    Distribution distribution(context_.stack, delegate_, target, rules_, recorder);
    auto refused = distribution.distribute(taken);
    if (std::exchange(structureChanged_, false)) {
        const double rate = delegate_->GetTimeCodesPerSecond();
        delegate_->Clear();
        if (rate != delegate_->GetTimeCodesPerSecond()) delegate_->SetTimeCodesPerSecond(rate);
    } else {
        for (const auto& [path, below] : stale) distribution.refresh(path, below);
    }
    return refused;
}

Distribution DelegateAuthoring::distribution() const {
    return {context_.stack, delegate_, SdfLayerHandle(), rules_};
}

}  // namespace usdlive::layers
