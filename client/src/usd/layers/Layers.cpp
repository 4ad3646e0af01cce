// Connects the parts of Layers with the notices of a stage, and runs the frame.
#include "usdlive/client/usd/layers/Layers.h"

#include <pxr/base/tf/notice.h>
#include <pxr/base/tf/weakBase.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/notice.h>
#include <pxr/usd/sdf/schema.h>

#include <set>
#include <string>
#include <thread>
#include <utility>

#include "basics/SystemUser.h"
#include "usd/layers/DelegateAuthoring.h"
#include "usd/layers/Distribution.h"
#include "usd/layers/LayersContext.h"
#include "usd/layers/LockedSpecs.h"
#include "usd/layers/SpecLinks.h"
#include "usd/layers/StageLayerStates.h"
#include "usdlive/client/usd/Misuse.h"

namespace usdlive::layers {

using pxr::SdfLayerHandle;
using pxr::SdfPath;
using pxr::TfToken;

namespace {

constexpr std::size_t kMaxRefusedEdits = 10'000;

bool isInfo(const TfToken& field) {
    static const std::set<std::string> kFields{
        "upAxis",      "metersPerUnit",   "startTimeCode",
        "endTimeCode", "framesPerSecond", "timeCodesPerSecond",
        "comment",     "documentation",   "customLayerData"};
    return kFields.contains(field.GetString());
}

// Returns whether offset, scale or both differ in another list of offsets.
std::vector<std::string> offsetTokens(const pxr::SdfChangeList::Entry::InfoChange& change) {
    using Offsets = pxr::SdfLayerOffsetVector;
    const auto before = change.first.GetWithDefault<Offsets>();
    const auto after = change.second.GetWithDefault<Offsets>();
    bool offset = before.size() != after.size(), scale = offset;
    for (std::size_t i = 0; i < std::min(before.size(), after.size()); ++i) {
        offset = offset || before[i].GetOffset() != after[i].GetOffset();
        scale = scale || before[i].GetScale() != after[i].GetScale();
    }
    std::vector<std::string> tokens;
    if (offset) tokens.emplace_back("subLayerOffsets_offset");
    if (scale) tokens.emplace_back("subLayerOffsets_scale");
    return tokens;
}

// Returns true if the changes may change which layers the stage uses.
bool changesComposition(const pxr::SdfChangeList& changes) {
    const auto& keys = pxr::SdfFieldKeys;
    for (const auto& [path, entry] : changes.GetEntryList()) {
        const auto& flags = entry.flags;
        if (flags.didReplaceContent || flags.didAddNonInertPrim || flags.didRemoveNonInertPrim ||
            flags.didChangePrimVariantSets || flags.didChangePrimReferences || flags.didRename)
            return true;
        for (const auto& [field, change] : entry.infoChanged)
            if (field == keys->References || field == keys->Payload || field == keys->Active ||
                field == keys->VariantSelection || field == keys->InheritPaths ||
                field == keys->Specializes || field == keys->LayerRelocates)
                return true;
    }
    return false;
}

}  // namespace

class Layers::Impl final : public pxr::TfWeakBase, public DistributionRules {
public:
    Impl(std::unique_ptr<StageHost> host, Options options)
        : host_(std::move(host)),
          context_(*host_),
          thread_(std::this_thread::get_id()),
          states_(withLive(context_, options.live)),
          authoring_(context_, *this),
          links_(context_),
          lockedSpecs_(context_,
                       options.user.empty() ? client::systemUser() : std::move(options.user)),
          editTarget_(host_->editTarget()) {
        (void)context_.events.take();
        const auto self = pxr::TfCreateWeakPtr(this);
        keys_ = {pxr::TfNotice::Register(self, &Impl::onChanged),
                 pxr::TfNotice::Register(self, &Impl::onDirtiness, SdfLayerHandle()),
                 pxr::TfNotice::Register(self, &Impl::onSaved, SdfLayerHandle()),
                 pxr::TfNotice::Register(self, &Impl::onReloaded, SdfLayerHandle()),
                 pxr::TfNotice::Register(self, &Impl::onMuteness)};
    }

    ~Impl() override { pxr::TfNotice::Revoke(&keys_); }

    // --- DistributionRules

    [[nodiscard]] std::optional<LayerError> whyNotWritable(const SdfLayerHandle& layer) override {
        return state.whyNotWritable(layer);
    }
    [[nodiscard]] std::optional<LayerError> whyLocked(const SdfPath& spec) override {
        return lockedSpecs_.whyLocked(spec);
    }
    [[nodiscard]] std::vector<SdfLayerHandle> linkedLayers(const SdfPath& spec) override {
        if (mode_ != LayerEditMode::SpecsLinking) return {};
        return links_.layersFor(spec);
    }

    // --- modes

    LayerResult<void> setEditMode(LayerEditMode mode) {
        if (mode == mode_) return {};
        const bool wasDelegating = mode_ != LayerEditMode::Normal;
        const bool delegates = mode != LayerEditMode::Normal;
        if (wasDelegating) {
            // The edits belong to the mode in which they were written.
            authoring_.resume();
            distribute();
        }
        if (delegates)
            if (auto enabled = authoring_.enable(); !enabled) return enabled;
        if (wasDelegating && !delegates) authoring_.disable();
        mode_ = mode;
        states_.layers.hide(delegates ? authoring_.delegate()->GetIdentifier() : std::string());
        context_.events.push(LayerEventType::EditModeChanged);
        followEditTarget();
        return {};
    }

    // --- the frame

    std::vector<RefusedEdit> update(double nowMs) {
        states_.watch(nowMs);
        authoring_.keepInPlace();
        followEditTarget();
        return distribute();
    }

    void refuse(std::vector<RefusedEdit> edits) {
        if (!edits.empty()) notify(edits);
    }

    std::vector<RefusedEdit> distributeAll(content::Recorder* recorder) {
        const bool suspended = authoring_.isSuspended();
        authoring_.resume();
        auto refused = distribute(recorder);
        if (suspended) authoring_.suspend();
        return refused;
    }

    std::vector<LayerEvent> takeEvents() { return context_.events.take(); }
    [[nodiscard]] bool isElsewhere() const { return std::this_thread::get_id() != thread_; }
    void setLive(LiveLayers* live) {
        context_.live = live;
        states_.layers.structureChanged();
    }

private:
    static LayersContext& withLive(LayersContext& context, LiveLayers* live) {
        context.live = live;
        return context;
    }

    std::vector<RefusedEdit> distribute(content::Recorder* recorder = nullptr) {
        std::vector<RefusedEdit> refused;
        {
            // The block's notices at its end are caused by us, so the delegate ignores them.
            distributing_ = true;
            const pxr::SdfChangeBlock block;
            refused = lockedSpecs_.update(authoring_.delegate());
            auto more = authoring_.update(recorder);
            refused.insert(refused.end(), std::make_move_iterator(more.begin()),
                           std::make_move_iterator(more.end()));
        }
        distributing_ = false;
        if (!refused.empty()) notify(refused);
        return refused;
    }

    void notify(const std::vector<RefusedEdit>& refused) {
        LayerEvent event;
        event.type = LayerEventType::EditsRefused;
        for (const auto& edit : refused) event.paths.push_back(edit.path);
        context_.events.push(std::move(event));
        for (const auto& edit : refused) {
            if (this->refused.size() == kMaxRefusedEdits) this->refused.pop_front();
            this->refused.push_back(edit);
        }
    }

    void followEditTarget() {
        const auto now = host_->editTarget();
        if (std::exchange(editTarget_, now) == now) return;
        context_.events.push(LayerEventType::EditTargetChanged);
    }

    // --- notices

    // Ignores notices from other threads: they concern layers that the stage does not use.
    void onChanged(const pxr::SdfNotice::LayersDidChange& notice) {
        if (isElsewhere()) return;
        context_.stack.follow(notice.GetChangeListVec());
        for (const auto& [layer, changes] : notice) {
            if (!layer) continue;
            const bool isDelegate = layer == authoring_.delegate();
            const bool local = !isDelegate && state.hasLocalLayer(layer->GetIdentifier());
            if ((isDelegate || local) && !distributing_) authoring_.layerChanged(layer, changes);
            if (!local && (isDelegate || !states_.layers.known(layer->GetIdentifier()))) continue;
            states_.dirtiness.edited(layer);
            if (changesComposition(changes)) states_.layers.compositionChanged();
            lockedSpecs_.layerChanged(layer, changes);
            notify(layer, changes);
        }
    }

    void notify(const SdfLayerHandle& layer, const pxr::SdfChangeList& changes) {
        LayerEvent specs;
        specs.type = LayerEventType::PrimSpecsChanged;
        specs.layer = layer->GetIdentifier();
        for (const auto& [path, entry] : changes.GetEntryList()) {
            if (path == SdfPath::AbsoluteRootPath()) {
                notifyLayer(layer, entry);
                continue;
            }
            specs.paths.push_back(path.ContainsTargetPath() ? path.GetParentPath() : path);
            if (entry.flags.didRename) specs.paths.push_back(entry.oldPath);
        }
        if (!specs.paths.empty()) context_.events.push(std::move(specs));
    }

    void notifyLayer(const SdfLayerHandle& layer, const pxr::SdfChangeList::Entry& entry) {
        std::vector<std::string> tokens;
        bool sublayers = entry.flags.didReplaceContent, structure = sublayers;
        for (const auto& [field, change] : entry.infoChanged) {
            if (isInfo(field)) tokens.push_back(field.GetString());
            if (field == pxr::SdfFieldKeys->SubLayers) sublayers = true;
            if (field == pxr::SdfFieldKeys->SubLayerOffsets)
                for (auto& token : offsetTokens(change)) tokens.push_back(std::move(token));
            structure = structure || field == pxr::SdfFieldKeys->TimeCodesPerSecond ||
                        field == pxr::SdfFieldKeys->FramesPerSecond ||
                        field == pxr::SdfFieldKeys->ExpressionVariables ||
                        field == pxr::SdfFieldKeys->SubLayerOffsets;
        }
        for (const auto& [path, change] : entry.subLayerChanges) {
            structure = true;
            if (change != pxr::SdfChangeList::SubLayerOffset) sublayers = true;
        }
        if (entry.flags.didChangeIdentifier || entry.flags.didChangeResolvedPath) sublayers = true;
        if (sublayers || structure) onStructure(sublayers && !isDelegateAlone(layer));
        if (!tokens.empty()) {
            const bool data = std::ranges::find(tokens, "customLayerData") != tokens.end();
            context_.events.push(
                {LayerEventType::InfoChanged, layer->GetIdentifier(), std::move(tokens), {}, {}});
            if (data) onData(layer);
        }
        if (entry.flags.didReplaceContent) onData(layer);
    }

    // Returns true if only our own delegate was inserted or removed, which is no change for users.
    [[nodiscard]] bool isDelegateAlone(const SdfLayerHandle& layer) {
        if (layer != host_->sessionLayer()) return false;
        std::vector<std::string> now;
        for (const std::string& path : std::vector<std::string>(layer->GetSubLayerPaths()))
            if (!DelegateAuthoring::isDelegate(path)) now.push_back(path);
        return std::exchange(sessionSublayers_, now) == now;
    }

    void onStructure(bool sublayers) {
        authoring_.structureChanged();
        if (!sublayers) return;
        states_.layers.structureChanged();
        lockedSpecs_.structureChanged();
        context_.events.push(LayerEventType::SublayersChanged);
        context_.events.push(LayerEventType::UsedLayersChanged);
    }

    void onData(const SdfLayerHandle& layer) {
        states_.dataChanged(layer);
        if (layer != host_->rootLayer()) return;
        links_.dataChanged();
        lockedSpecs_.dataChanged();
    }

    void onDirtiness(const pxr::SdfNotice::LayerDirtinessChanged&, const SdfLayerHandle& layer) {
        if (!isElsewhere()) states_.dirtiness.sdfReports(layer);
    }
    void onSaved(const pxr::SdfNotice::LayerDidSaveLayerToFile&, const SdfLayerHandle& layer) {
        if (!isElsewhere()) states_.files.agrees(layer);
    }
    void onReloaded(const pxr::SdfNotice::LayerDidReloadContent&, const SdfLayerHandle& layer) {
        if (!isElsewhere()) states_.files.agrees(layer);
    }
    // A notice of SdfLayer itself. A layer has no content while it is muted.
    void onMuteness(const pxr::SdfNotice::LayerMutenessChanged&) {
        if (isElsewhere()) return;
        authoring_.structureChanged();
    }

    const std::unique_ptr<StageHost> host_;
    LayersContext context_;
    const std::thread::id thread_;
    StageLayerStates states_;
    DelegateAuthoring authoring_;
    SpecLinks links_;
    LockedSpecs lockedSpecs_;

public:
    LayersState state{states_};
    AutoAuthoring autoAuthoring{authoring_};
    SpecsLinking linking{links_};
    SpecsLocking locking{lockedSpecs_};
    std::deque<RefusedEdit> refused;
    LayersContext& context() { return context_; }
    [[nodiscard]] LayerEditMode mode() const { return mode_; }

private:
    LayerEditMode mode_ = LayerEditMode::Normal;
    bool distributing_ = false;
    SdfLayerHandle editTarget_;
    std::vector<std::string> sessionSublayers_;
    pxr::TfNotice::Keys keys_;
};

Layers::Layers(std::unique_ptr<StageHost> host) : Layers(std::move(host), Options()) {}
Layers::Layers(std::unique_ptr<StageHost> host, Options options)
    : impl_(std::make_unique<Impl>(std::move(host), std::move(options))) {}
Layers::~Layers() = default;

Layers::Impl& Layers::here(const char* function) const {
    if (impl_->isElsewhere())
        throw Misuse({ErrorCode::InvalidArgument,
                      std::string("Layers::") + function +
                          "() was called on another thread than the one that made these layers. A "
                          "stage and its layers belong to one thread: call it there"});
    return *impl_;
}

LayersState& Layers::state() { return here("state").state; }
AutoAuthoring& Layers::autoAuthoring() { return here("autoAuthoring").autoAuthoring; }
SpecsLinking& Layers::specsLinking() { return here("specsLinking").linking; }
SpecsLocking& Layers::specsLocking() { return here("specsLocking").locking; }
StageHost& Layers::host() { return here("host").context().host; }
LayerEditMode Layers::editMode() const { return here("editMode").mode(); }
LayerResult<void> Layers::setEditMode(LayerEditMode mode) {
    return here("setEditMode").setEditMode(mode);
}
std::vector<RefusedEdit> Layers::update(double nowMs) { return here("update").update(nowMs); }
void Layers::refuse(std::vector<RefusedEdit> edits) { here("refuse").refuse(std::move(edits)); }
std::vector<RefusedEdit> Layers::distribute(content::Recorder* recorder) {
    return here("distribute").distributeAll(recorder);
}
std::vector<LayerEvent> Layers::takeEvents() { return here("takeEvents").takeEvents(); }
const std::deque<RefusedEdit>& Layers::refusedEdits() const { return here("refusedEdits").refused; }
void Layers::setLive(LiveLayers* live) { here("setLive").setLive(live); }

}  // namespace usdlive::layers
