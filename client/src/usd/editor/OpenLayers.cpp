// Makes layers live, and stops it.
#include "usd/editor/OpenLayers.h"

#include <pxr/usd/sdf/layerUtils.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <utility>

#include "basics/Clocks.h"
#include "session/Permissions.h"
#include "usd/live/EarlyWork.h"
#include "usd/live/LayerClaims.h"
#include "usd/places/UsedLayers.h"
#include "usdlive/common/core/LayerPath.h"

namespace usdlive::client {

namespace {

// The budget for making layers findable: in the first tick that knows the project, and in a later
// one.
constexpr double kFirstFindableMs = 200, kFindableMs = 1;
// The most loaded layers that one tick checks.
constexpr std::size_t kLookedAtPerTick = 100;
// The pauses between attempts to join a layer that the server could not give. They get longer.
constexpr std::int64_t kFirstPauseMs = 1'000, kLongestPauseMs = 8'000;

}  // namespace

OpenLayers::OpenLayers(Dependencies dependencies)
    : with_(std::move(dependencies)),
      clips_(with_.places, with_.files,
             [this](const LayerId& id) { return isOfProject(id) && !find(id); }),
      views_(live_, with_.values.source()) {}

std::optional<LayerId> OpenLayers::idOf(const pxr::SdfLayerHandle& layer) const {
    const LiveLayer* live = live_.find(layer);
    return live ? std::optional(live->id()) : std::nullopt;
}

// --- the project

const std::set<LayerId>& OpenLayers::ofProject() const { return with_.session.projectLayers(); }

bool OpenLayers::isOfProject(const LayerId& id) const { return ofProject().contains(id); }

void OpenLayers::projectChanged(const std::vector<LayerId>& added) {
    // The project may have the failed layers now, and layers that others use.
    failed_.clear();
    for (auto& [id, awaited] : awaited_) awaited.retryAtMs = 0;
    if (!added.empty()) used_.clear();
    with_.places.add(added, std::exchange(knowsProject_, true) ? kFindableMs : kFirstFindableMs);
    std::erase_if(guessed_, [this](const LayerId& id) { return isOfProject(id); });
    clips_.projectChanged(added);
}

// --- opening

Result<void> OpenLayers::open(const LayerId& id) {
    if (auto valid = parseLayerId(id.value); !valid) return tl::unexpected(valid.error());
    const auto made = with_.places.makeFindable(id);
    if (!made && !isOfProject(id))
        return fail(ErrorCode::LayerNotFound, "the project has no layer " + id.value);
    if (!made) return tl::unexpected(made.error());
    if (*made && !isOfProject(id)) guessed_.insert(id);
    clips_.opens(id);
    const auto identifier = with_.places.identifierOf(id);
    const auto layer = pxr::SdfLayer::FindOrOpen(identifier);
    if (!layer) return fail(ErrorCode::LayerUnreadable, "cannot open " + identifier);
    return join(id, layer);
}

Result<void> OpenLayers::join(const LayerId& id, const pxr::SdfLayerRefPtr& layer) {
    if (find(id)) return {};
    if (!LayerClaims::ofProcess().claim(layer, this)) {
        failed_.insert(id);
        return tl::unexpected(liveElsewhere(id));
    }
    failed_.erase(id);
    closed_.erase(id);
    BlobCache& blobs = with_.values.cache();
    keepEarlyWork(id, layer, blobs, with_.lost);
    live_.add(std::make_unique<LiveLayer>(
        id, layer,
        LiveLayer::Dependencies{
            with_.values.source(), blobs, with_.sink, with_.filler,
            [this, id] { return with_.session.view(id); },
            [this](Error error) { with_.events.report(std::move(error)); },
            [this, id] { live_.wake(id); },
            [this, layer](const std::set<std::string>& assets) {
                clips_.addClips(layer, assets, ofProject());
            },
            [this, layer](const std::set<std::string>& assets) { openNamed(layer, assets); }}));
    followLock(id);
    with_.session.openLayer(id);
    return {};
}

const std::vector<LayerId>& OpenLayers::openUsed(LiveLayer& live, LoadSet load) {
    const auto [known, isNew] = used_.try_emplace(live.id());
    if (!isNew && known->second.load == load && !live.usesChanged()) return known->second.layers;
    std::vector<LayerId> opened;
    for (const auto& [identifier, id] : usedBy(live, load)) {
        if (const auto made = with_.places.makeFindable(id); !made)
            with_.events.report(made.error());
        clips_.opens(id);
        const std::string file = pxr::SdfLayer::SplitIdentifier(identifier).first;
        if (mayJoin(id))
            if (auto used = pxr::SdfLayer::FindOrOpen(file))
                if (const auto joined = join(id, used); !joined)
                    with_.events.push(event::JoinFailed{id, joined.error()});
        if (file != identifier)
            if (const auto view = pxr::SdfLayer::FindOrOpen(identifier)) adoptView(view);
        if (find(id)) opened.push_back(id);
    }
    Used& used = used_[live.id()];
    used = {load, std::move(opened)};
    return used.layers;
}

// Returns the used layers that are in the project, with their identifiers.
std::vector<std::pair<std::string, LayerId>> OpenLayers::usedBy(const LiveLayer& live,
                                                                LoadSet load) const {
    std::vector<std::pair<std::string, LayerId>> used;
    if (!live.uses().namesLayers()) return used;
    for (const auto& asset : usedAssets(live.layer(), load)) {
        auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(live.layer(), asset);
        auto id = with_.places.layerAt(identifier);
        if (id && isOfProject(*id)) used.emplace_back(std::move(identifier), std::move(*id));
    }
    return used;
}

bool OpenLayers::hasUsed(const LayerId& id, LoadSet load) const {
    if (load == LoadSet::NoPayloads) return true;
    const auto found = used_.find(id);
    const LiveLayer* live = find(id);
    return found != used_.end() && found->second.load == LoadSet::All && live && live->isIdle();
}

bool OpenLayers::failed(const LayerId& id, const Error& reason) {
    const LiveLayer* live = find(id);
    const auto layer = live ? live->layer() : pxr::SdfLayerRefPtr();
    leave(id);
    if (guessed_.erase(id) > 0) with_.places.remove(id);
    if (!layer || reason.code == ErrorCode::LayerNotFound) {
        awaited_.erase(id);
        failed_.insert(id);
        return true;
    }
    LayerClaims::ofProcess().close(layer);  // also a file, which would then replace the server's
    const auto [entry, isNew] = awaited_.try_emplace(id, Awaited{layer, reason, 0, 0});
    Awaited& awaited = entry->second;
    awaited.pauseMs = std::clamp(2 * awaited.pauseMs, kFirstPauseMs, kLongestPauseMs);
    awaited.retryAtMs = steadyMs() + awaited.pauseMs;
    return isNew || std::exchange(awaited.reason, reason) != reason;
}

void OpenLayers::joinAwaited(std::int64_t nowMs) {
    if (!with_.session.isConnected()) return;
    for (auto& [id, awaited] : awaited_) {
        if (awaited.retryAtMs > nowMs || find(id)) continue;
        awaited.retryAtMs = nowMs + awaited.pauseMs;
        static_cast<void>(join(id, awaited.layer));
    }
}

std::vector<std::pair<LayerId, pxr::SdfLayerRefPtr>> OpenLayers::loadedHere() const {
    std::vector<std::pair<LayerId, pxr::SdfLayerRefPtr>> loaded;
    for (const auto& layer : pxr::SdfLayer::GetLoadedLayers())
        if (auto id = live_.find(layer) ? std::nullopt : layerOf(layer))
            loaded.emplace_back(std::move(*id), layer);
    std::ranges::sort(loaded, {}, [](const auto& one) { return one.first; });
    return loaded;
}

std::optional<LayerId> OpenLayers::layerOf(const pxr::SdfLayerHandle& layer) const {
    auto id = nameOf(layer);
    return id && !find(*id) && !clips_.contains(*id) ? id : std::nullopt;
}

std::optional<LayerId> OpenLayers::nameOf(const pxr::SdfLayerHandle& layer) const {
    // A layer with file format arguments is a view of its file, not the file itself.
    if (!layer || layer->IsAnonymous() || !layer->GetFileFormatArguments().empty())
        return std::nullopt;
    auto id = with_.places.layerOf(layer);
    return id && isOfProject(*id) ? id : std::nullopt;
}

bool OpenLayers::isLiveElsewhere(const pxr::SdfLayerHandle& layer) const {
    return LayerClaims::ofProcess().isLiveElsewhere(layer, this);
}

Error OpenLayers::liveElsewhere(const LayerId& id) {
    return {ErrorCode::InvalidArgument,
            id.value +
                " is already live through another connection of this process. Use that one, or "
                "open a copy with another cache folder"};
}

// An editor that names a layer reads what it brings at once, as importers do. Waits for the server,
// but never within a tick.
void OpenLayers::openNamed(const pxr::SdfLayerHandle& layer, const std::set<std::string>& assets) {
    for (const std::string& asset : assets) {
        if (!with_.files.mayWait()) return;
        const auto identifier = pxr::SdfComputeAssetPathRelativeToLayer(layer, asset);
        const auto id = with_.places.layerAt(identifier);
        const std::string file = pxr::SdfLayer::SplitIdentifier(identifier).first;
        if (!id || !isOfProject(*id) || !mayJoin(*id) || clips_.contains(*id) ||
            pxr::SdfLayer::Find(file))
            continue;
        static_cast<void>(with_.places.makeFindable(*id));
        const auto named = with_.files.openWithContent(id->value, file);
        if (!named || !join(*id, named)) continue;
        openNamed(named, usedAssets(named, LoadSet::All));
    }
}

// --- closing

// Takes the id by value, because this function may remove the caller's.
void OpenLayers::leave(LayerId id) {
    const LiveLayer* live = find(id);
    if (!live) return;
    const pxr::SdfLayerRefPtr layer = live->layer();
    const LayerDoc* view = live->isFilled() ? with_.session.view(id) : nullptr;
    auto left = view ? std::optional(*view) : std::nullopt;
    live_.remove(id);
    used_.erase(id);
    LayerClaims::ofProcess().release(layer, this, std::move(left));
    refuseEdits(layer);
}

void OpenLayers::leaveAll() {
    while (!live_.all().empty()) leave(live_.all().begin()->first);
    for (const auto& [id, awaited] : std::exchange(awaited_, {})) abandon(awaited.layer);
}

void OpenLayers::close(const LayerId& id) {
    const auto awaited = awaited_.extract(id);
    if (!awaited && !find(id)) return;
    leave(id);
    if (awaited) abandon(awaited.mapped().layer);
    with_.session.closeLayer(id);
    closed_.insert(id);
    clips_.closed(id);
}

// --- parts of a tick

void OpenLayers::adoptLoaded(double budgetMs) {
    const Stopwatch watch;
    bool just = false;
    for (LiveLayer* live : live_.active()) {
        if (!live->takeUsesChanged()) continue;
        just = true;
        used_.erase(live->id());
    }
    if (!with_.session.welcome()) return;
    joinAwaited(steadyMs());
    loaded_.look(just, live_.known(), with_.background);
    for (std::size_t looked = 0; looked < kLookedAtPerTick; ++looked) {
        const auto layer = loaded_.next();
        if (!layer) return;
        adopt(layer);
        if (watch.ms() >= budgetMs) return;
    }
}

void OpenLayers::adoptAllLoaded() {
    for (const auto& layer : pxr::SdfLayer::GetLoadedLayers())
        if (layer) adopt(pxr::SdfLayerRefPtr(layer));
}

bool OpenLayers::mayJoin(const LayerId& id) const {
    return !find(id) && !failed_.contains(id) && !isAwaited(id) && !closed_.contains(id);
}

bool OpenLayers::adoptView(const pxr::SdfLayerRefPtr& layer) {
    if (layer->GetFileFormatArguments().empty() || !with_.places.isPlaceholder(layer)) return false;
    const auto id = with_.places.layerOf(layer);
    if (!id || !isOfProject(*id)) return false;
    const auto file = pxr::SdfLayer::SplitIdentifier(layer->GetIdentifier()).first;
    if (mayJoin(*id))
        if (const auto shown = pxr::SdfLayer::FindOrOpen(file)) static_cast<void>(join(*id, shown));
    views_.add(*id, layer);
    return true;
}

void OpenLayers::adopt(const pxr::SdfLayerRefPtr& layer) {
    if (live_.find(layer) || layer->IsAnonymous() || adoptView(layer)) return;
    const auto id = layerOf(layer);
    if (!id || !mayJoin(*id))
        refuseEdits(layer);
    else if (!isLiveElsewhere(layer))
        static_cast<void>(join(*id, layer));
}

// Nobody would get the edits.
void OpenLayers::refuseEdits(const pxr::SdfLayerHandle& layer) const {
    if (with_.places.isPlaceholder(layer)) LayerClaims::ofProcess().close(layer);
}

void OpenLayers::abandon(const pxr::SdfLayerRefPtr& layer) const {
    if (!with_.places.isPlaceholder(layer)) LayerClaims::ofProcess().open(layer);
}

std::size_t OpenLayers::fill(double budgetMs) {
    const Stopwatch watch;
    std::size_t filling = 0;
    for (LiveLayer* live : live_.active()) {
        if (live->isFilling() && watch.ms() < budgetMs) {
            live->fill();
            if (live->isFilled()) awaited_.erase(live->id());
            if (live->isFilled() && clips_.areClips(live->id())) filledClips_.push_back(live->id());
        }
        filling += live->isFilling() ? 1 : 0;
    }
    return filling;
}

void OpenLayers::makeNamedFindable() {
    std::vector<std::pair<LiveLayer*, std::set<std::string>>> clips;
    for (LiveLayer* live : live_.active()) {
        if (!live->uses().hasNew()) continue;
        const auto named = live->takeNamed();
        clips_.addArcs(live->layer(), named.arcs);
        if (!named.clips.empty()) clips.emplace_back(live, named.clips);
    }
    for (const auto& [live, named] : clips) clips_.addClips(live->layer(), named, ofProject());
    if (with_.places.isComplete()) return;
    for (const LiveLayer* live : live_.active()) {
        if (!live->usesChanged()) continue;
        for (const auto& [identifier, id] : usedBy(*live, LoadSet::All))
            if (const auto made = with_.places.makeFindable(id); !made)
                with_.events.report(made.error());
    }
}

void OpenLayers::followLock(const LayerId& id) {
    auto* live = find(id);
    if (!live || !with_.session.welcome()) return;
    live->setForbidden(!mayWriteIn(with_.session, id));
}

void OpenLayers::followLocks() {
    for (const auto& entry : live_.all()) followLock(entry.first);
}

}  // namespace usdlive::client
