// Answers queries about the layers of a stage and sets their flags.
#include "usdlive/client/usd/layers/LayersState.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <utility>

#include "usd/layers/FileWatch.h"
#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"
#include "usdlive/client/usd/layers/LayerUtils.h"

namespace usdlive::layers {

namespace {

constexpr double kLookEveryMs = 500;

const std::string kMuteness = "muteness", kLocked = "locked";

}  // namespace

LayersState::LayersState(LayersContext& context)
    : context_(context), watch_(std::make_unique<FileWatch>()) {
    const auto muted = context_.host.mutedLayers();
    stageMuted_ = localMuted_ = {muted.begin(), muted.end()};
    learnFlags();
    learnStructure();
}

LayersState::~LayersState() = default;

// ------------------------------------------------------------------ layers

bool LayersState::isRoot(const std::string& id) const {
    return id == context_.host.rootLayer()->GetIdentifier();
}

bool LayersState::isSession(const std::string& id) const {
    const auto session = context_.host.sessionLayer();
    return session && id == session->GetIdentifier();
}

LayersState::Known* LayersState::find(const std::string& id) {
    if (!structureKnown_) learnStructure();
    auto found = known_.find(id);
    if (found == known_.end()) found = known_.find(LayerUtils::normalizeUrl(id));
    return found == known_.end() ? nullptr : &found->second;
}

std::optional<LayerError> LayersState::whyUnknown(const std::string& id) {
    if (find(id)) return std::nullopt;
    if (id.empty()) return LayerError{LayerErrorType::InvalidParam, "no layer is named"};
    return LayerError{LayerErrorType::NotFound, "the stage does not use a layer " + id};
}

void LayersState::learnSublayers(const pxr::SdfLayerHandle& layer, bool session,
                                 std::set<std::string>& visited) {
    LayerUtils::iterateSublayers(
        layer, [&](const auto&, int, const std::string& id, const pxr::SdfLayerHandle& sublayer) {
            if (id == hidden_ || !visited.insert(id).second) return true;
            if (!sublayer && !stageMuted_.contains(id)) {
                invalid_.push_back(id);
                return true;
            }
            auto& known = known_[id];
            known.layer = sublayer;
            known.local = true;
            known.session = session;
            order_.push_back(id);
            return true;
        });
}

void LayersState::learnStructure() {
    structureKnown_ = usedKnown_ = true;
    auto before = std::exchange(known_, {});
    order_.clear();
    invalid_.clear();
    used_.clear();
    std::set<std::string> visited;
    for (const auto& top : {context_.host.rootLayer(), context_.host.sessionLayer()}) {
        if (!top) continue;
        const bool session = top == context_.host.sessionLayer();
        if (visited.insert(top->GetIdentifier()).second) {
            auto& known = known_[top->GetIdentifier()];
            known.layer = top;
            known.local = true;
            known.session = session;
            order_.push_back(top->GetIdentifier());
        }
        learnSublayers(top, session, visited);
    }
    for (const auto& layer : context_.host.usedLayers()) {
        if (!layer || layer->GetIdentifier() == hidden_) continue;
        auto& known = known_[layer->GetIdentifier()];
        known.layer = layer;
        known.used = true;
        used_.insert(layer->GetIdentifier());
    }
    for (auto& [id, known] : known_) {
        known.ownLock = hasOwnLock(known.layer);
        known.locked = known.local && isLocked(id, known);
        const auto old = before.find(id);
        if (old == before.end()) {
            readFileState(known);
            continue;
        }
        known.outdated = old->second.outdated;
        known.readOnly = old->second.readOnly;
        known.dirty = old->second.dirty;
        known.saved = old->second.saved;
        known.editedAt = old->second.editedAt;
        known.acknowledged = old->second.acknowledged;
        known.owner = std::move(old->second.owner);
    }
    nextLookMs_ = 0;
}

void LayersState::learnUsed() {
    usedKnown_ = true;
    std::set<std::string> now;
    for (const auto& layer : context_.host.usedLayers())
        if (layer && layer->GetIdentifier() != hidden_) now.insert(layer->GetIdentifier());
    if (now == used_) return;
    context_.events.push(LayerEventType::UsedLayersChanged);
    learnStructure();
}

std::optional<LiveState> LayersState::liveState(const Known& known) const {
    return context_.live ? context_.live->state(known.layer) : std::nullopt;
}

// Reads the state for queries before the first watch().
void LayersState::readFileState(Known& known) {
    if (!known.layer || known.layer->IsAnonymous()) return;
    if (const auto live = liveState(known)) {
        known.readOnly = !live->writable;
        known.dirty = live->dirty;
        known.saved = live->saved;
        return;
    }
    const auto seen = FileWatch::glance(known.layer->GetRealPath());
    known.readOnly = seen.readOnly;
    known.owner = seen.owner;
}

void LayersState::hide(const std::string& identifier) {
    hidden_ = identifier;
    structureChanged();
}

// ------------------------------------------------------------------ muteness

const std::set<std::string>& LayersState::flagsOfScope() const {
    return globalScope_ ? globalMuted_ : localMuted_;
}

void LayersState::applyScope(const std::set<std::string>& wanted) {
    std::vector<std::string> mute, unmute;
    for (const auto& id : wanted)
        if (!stageMuted_.contains(id)) mute.push_back(id);
    for (const auto& id : stageMuted_)
        if (!wanted.contains(id)) unmute.push_back(id);
    if (mute.empty() && unmute.empty()) return;
    applying_ = true;
    const auto apply = [&] { context_.host.muteAndUnmute(mute, unmute); };
    if (context_.live)
        context_.live->withoutWaiting(apply);
    else
        apply();
    applying_ = false;
    const auto now = context_.host.mutedLayers();
    stageMuted_ = {now.begin(), now.end()};
    mute.insert(mute.end(), unmute.begin(), unmute.end());
    context_.events.push(LayerEventType::MutenessStateChanged, std::move(mute));
    context_.stack.mutenessChanged();
    structureChanged();
}

void LayersState::setMutenessScope(bool global) {
    if (globalScope_ == global) return;
    followMuteness();
    globalScope_ = global;
    context_.events.push(LayerEventType::MutenessScopeChanged);
    applyScope(flagsOfScope());
}

void LayersState::followMuteness() {
    if (std::exchange(scopeDue_, false) && globalScope_) applyScope(globalMuted_);
    mutenessChanged();
    if (unwrittenFlags_.empty()) return;
    const auto root = context_.host.rootLayer();
    auto flags = std::exchange(unwrittenFlags_, {});
    const auto written = layerFlags(root, kMuteness);
    // A layer that was removed from the stack is unmuted, and its flag is removed already.
    std::erase_if(flags, [&](const auto& flag) {
        return !flag.second && !written.contains(flag.first) && !hasLocalLayer(flag.first);
    });
    setLayerFlags(root, kMuteness, flags);
}

// Writes nothing, because it may be called by the stage while it mutes.
void LayersState::mutenessChanged() {
    if (applying_) return;
    const auto muted = context_.host.mutedLayers();
    const std::set<std::string> now(muted.begin(), muted.end());
    if (now == stageMuted_) return;
    std::vector<std::string> changed;
    std::ranges::set_symmetric_difference(stageMuted_, now, std::back_inserter(changed));
    stageMuted_ = now;
    if (globalScope_)
        for (const auto& id : changed) unwrittenFlags_[id] = now.contains(id);
    (globalScope_ ? globalMuted_ : localMuted_) = now;
    context_.events.push(LayerEventType::MutenessStateChanged, std::move(changed));
    context_.stack.mutenessChanged();
    structureChanged();
}

bool LayersState::isLayerMuted(const std::string& id) {
    mutenessChanged();
    return stageMuted_.contains(id);
}

bool LayersState::isLayerLocallyMuted(const std::string& id) { return localMuted_.contains(id); }

bool LayersState::isLayerGloballyMuted(const std::string& id) { return globalMuted_.contains(id); }

LayerResult<void> LayersState::setLayerGlobalMuteness(const std::string& id, bool muted) {
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    if (isRoot(id) || isSession(id))
        return fail(LayerErrorType::InvalidParam, id + " cannot be muted");
    if (!setLayerFlags(context_.host.rootLayer(), kMuteness, {{id, muted}}))
        return fail(LayerErrorType::ReadOnly,
                    "the root layer, which stores muteness, accepts no edits");
    learnFlags();
    if (globalScope_)
        applyScope(globalMuted_);
    else
        context_.events.push(LayerEventType::MutenessStateChanged, {id});
    return {};
}

void LayersState::learnFlags() {
    globalMuted_.clear();
    for (const auto& [id, muted] : layerFlags(context_.host.rootLayer(), kMuteness))
        if (muted) globalMuted_.insert(id);
    for (const auto& [id, muted] : unwrittenFlags_) {
        if (muted)
            globalMuted_.insert(id);
        else
            globalMuted_.erase(id);
    }
    lockFlags_ = layerFlags(context_.host.rootLayer(), kLocked);
}

// ------------------------------------------------------------------ locks

bool LayersState::isLocked(const std::string& id, const Known& known) const {
    if (isRoot(id) || known.session) return false;
    if (known.ownLock) return true;
    const auto flag = lockFlags_.find(id);
    return flag != lockFlags_.end() && flag->second;
}

bool LayersState::isLayerLocked(const std::string& id) {
    const auto* known = find(id);
    return known && known->local && isLocked(id, *known);
}

LayerResult<void> LayersState::setLayerLockState(const std::string& id, bool locked) {
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    auto* known = find(id);
    if (isRoot(id)) return fail(LayerErrorType::InvalidParam, "the root layer cannot be locked");
    if (!known->local || known->session)
        return fail(LayerErrorType::InvalidParam,
                    id + " is not a sublayer of the stage, so it cannot be locked");
    if (const auto live = liveState(*known); live && live->lockedByOther)
        return fail(LayerErrorType::ReadOnly,
                    id + " is locked by " + live->lockHolder.value +
                        ". Only they or an administrator of the server can unlock it");
    if (isLayerLocked(id) == locked) return {};
    const pxr::SdfLayerHandle layer = known->layer;
    if (!writeLock(id, *known, locked))
        return fail(LayerErrorType::ReadOnly,
                    id + " and the root layer do not both accept the edit of the lock");
    learnFlags();
    if ((known = find(id))) known->ownLock = hasOwnLock(layer);
    notifyLocks();
    return {};
}

// Writes nothing and returns false if a lock would stay, or if there is no place for one.
bool LayersState::writeLock(const std::string& id, const Known& known, bool locked) {
    const auto& layer = known.layer;
    const auto root = context_.host.rootLayer();
    const bool isLive = liveState(known).has_value();
    // A layer that is the root of another stage has that stage's map in the place of its own lock.
    // Then only our root layer stores the lock.
    const bool inLayer = layer && !omniValue(layer, kLocked).IsHolding<pxr::VtDictionary>() &&
                         (isLive || layer->PermissionToEdit());
    const auto map = omniValue(root, kLocked);
    const bool inRoot =
        root->PermissionToEdit() && (map.IsEmpty() || map.IsHolding<pxr::VtDictionary>());
    if (!inLayer && !inRoot) return false;
    const auto flag = lockFlags_.find(id);
    const bool isFlagged = flag != lockFlags_.end() && flag->second;
    if (!locked && ((known.ownLock && !inLayer) || (isFlagged && !inRoot))) return false;
    const auto writeFlag = [&] {
        if (inRoot) setLayerFlags(root, kLocked, {{id, locked}});
    };
    if (inLayer && isLive) return context_.live->setLocked(layer, locked, writeFlag);
    const pxr::SdfChangeBlock block;
    if (inLayer) setOmniValue(layer, kLocked, pxr::VtValue(locked));
    writeFlag();
    return true;
}

void LayersState::notifyLocks() {
    std::vector<std::string> changed;
    for (const auto& id : order_) {
        auto& known = known_[id];
        const bool locked = isLocked(id, known);
        if (std::exchange(known.locked, locked) != locked) changed.push_back(id);
    }
    if (!changed.empty())
        context_.events.push(LayerEventType::LockStateChanged, std::move(changed));
}

void LayersState::dataChanged(const pxr::SdfLayerHandle& layer) {
    if (!structureKnown_) return;  // everything is read again
    if (const auto found = known_.find(layer->GetIdentifier()); found != known_.end())
        found->second.ownLock = hasOwnLock(layer);
    if (layer == context_.host.rootLayer()) {
        const auto before = globalMuted_;
        learnFlags();
        std::vector<std::string> changed;
        std::ranges::set_symmetric_difference(before, globalMuted_, std::back_inserter(changed));
        if (!changed.empty()) {
            context_.events.push(LayerEventType::MutenessStateChanged, std::move(changed));
            // The stage follows in the next frame, because this may be inside a notice.
            scopeDue_ = true;
        }
    }
    notifyLocks();
}

// ------------------------------------------------------------------ writable

std::optional<LayerError> LayersState::whyNotWritable(const pxr::SdfLayerHandle& layer) {
    if (!layer) return LayerError{LayerErrorType::NotFound, "there is no such layer"};
    const std::string& id = layer->GetIdentifier();
    const auto* known = find(id);
    if (stageMuted_.contains(id)) return LayerError{LayerErrorType::ReadOnly, id + " is muted"};
    if (known && known->local && isLocked(id, *known)) {
        const auto live = context_.live ? context_.live->state(layer) : std::nullopt;
        const bool named = live && !live->lockHolder.empty();
        return LayerError{LayerErrorType::ReadOnly,
                          id + " is locked" + (named ? " by " + live->lockHolder.value : "")};
    }
    if (!layer->PermissionToEdit())
        return LayerError{LayerErrorType::ReadOnly, id + " does not permit edits"};
    if (known && known->readOnly)
        return LayerError{LayerErrorType::ReadOnly, "the file of " + id + " is read-only"};
    return std::nullopt;
}

bool LayersState::isLayerWritable(const std::string& id) {
    const auto* known = find(id);
    if (!known || known->readOnly || stageMuted_.contains(id)) return false;
    if (known->local && isLocked(id, *known)) return false;
    return known->layer && known->layer->PermissionToEdit();
}

bool LayersState::isLayerReadonlyOnDisk(const std::string& id) {
    const auto* known = find(id);
    return known && known->readOnly;
}

bool LayersState::isLayerSavable(const std::string& id) {
    if (!isLayerWritable(id)) return false;
    const auto* known = find(id);
    return known && !known->layer->IsAnonymous() && known->layer->PermissionToSave();
}

bool LayersState::isLayerDirty(const std::string& id) {
    const auto* known = find(id);
    if (!known || !known->layer || known->layer->IsAnonymous()) return false;
    const auto live = liveState(*known);
    return live ? isDirty(*known, *live) : known->layer->IsDirty();
}

std::vector<std::string> LayersState::dirtyLayerIdentifiers() {
    if (!structureKnown_) learnStructure();
    std::vector<std::string> dirty;
    for (const auto& id : used_)
        if (isLayerDirty(id)) dirty.push_back(id);
    return dirty;
}

void LayersState::dirtinessChanged(const pxr::SdfLayerHandle& layer) {
    if (!layer || layer->IsAnonymous() || !find(layer->GetIdentifier())) return;
    // The server reports the state of a live layer; its local file is a placeholder.
    if (!context_.live || !context_.live->state(layer))
        context_.events.push(LayerEventType::DirtyStateChanged, {layer->GetIdentifier()});
}

// Own edits are dirty before the server's state shows it, until they are saved.
bool LayersState::isDirty(const Known& known, const LiveState& live) {
    return live.dirty || (known.editedAt && (live.pending || *known.editedAt == live.saved));
}

void LayersState::edited(const pxr::SdfLayerHandle& layer) {
    if (!context_.live || context_.live->isApplying()) return;
    const auto found = known_.find(layer->GetIdentifier());
    if (found == known_.end() || found->second.dirty) return;
    auto& known = found->second;
    const auto live = liveState(known);
    if (!live) return;
    known.editedAt = live->saved;
    known.acknowledged = false;
    known.dirty = true;
    edited_.insert(found->first);
    context_.events.push(LayerEventType::DirtyStateChanged, {found->first});
}

// Returns whether the layer became dirty or clean, or was saved, since the last call.
bool LayersState::followDirtiness(Known& known, const LiveState& live) {
    const bool dirty = isDirty(known, live);
    if (live.dirty || !dirty) known.editedAt.reset();
    const Revision before = std::exchange(known.saved, live.saved);
    const bool wasSaved = before != 0 && before != live.saved;
    return std::exchange(known.dirty, dirty) != dirty || wasSaved;
}

// Follows the layers that this process has edited in every frame.
void LayersState::followEdits() {
    std::erase_if(edited_, [&](const std::string& id) {
        const auto found = known_.find(id);
        const auto live = found == known_.end() ? std::nullopt : liveState(found->second);
        if (!live) return true;
        if (followDirtiness(found->second, *live))
            context_.events.push(LayerEventType::DirtyStateChanged, {id});
        return !found->second.editedAt;
    });
}

// ------------------------------------------------------------------ names

LayerResult<void> LayersState::setLayerName(const std::string& id, const std::string& name) {
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    const auto* known = find(id);
    if (!known->layer) return fail(LayerErrorType::NotFound, id + " is not loaded");
    if (!LayerUtils::setCustomLayerName(known->layer, name))
        return fail(LayerErrorType::ReadOnly, id + " does not permit edits");
    return {};
}

std::string LayersState::layerName(const std::string& id) {
    if (isRoot(id)) return "Root Layer";
    if (isSession(id)) return "Session Layer";
    const auto* known = find(id);
    if (known && known->layer) {
        const auto custom = LayerUtils::customLayerName(known->layer);
        if (!custom.empty()) return custom;
    }
    if (pxr::SdfLayer::IsAnonymousLayerIdentifier(id)) return id;
    return unquoted(pxr::SdfLayer::GetDisplayNameFromIdentifier(id));
}

std::string LayersState::layerOwner(const std::string& id) {
    const auto* known = find(id);
    if (!known) return {};
    const auto live = context_.live ? context_.live->state(known->layer) : std::nullopt;
    return live ? live->owner : known->owner;
}

// ------------------------------------------------------------------ lists

std::vector<std::string> LayersState::localLayerIdentifiers(bool session, bool anonymous,
                                                            bool invalid) {
    if (!structureKnown_) learnStructure();
    std::vector<std::string> ids;
    for (const auto& id : order_) {
        if (!session && known_[id].session) continue;
        if (!anonymous && pxr::SdfLayer::IsAnonymousLayerIdentifier(id)) continue;
        ids.push_back(id);
    }
    if (invalid) ids.insert(ids.end(), invalid_.begin(), invalid_.end());
    return ids;
}

bool LayersState::hasLocalLayer(const std::string& id) {
    const auto* known = find(id);
    return known && known->local;
}

bool LayersState::hasUsedLayer(const std::string& id) {
    if (!usedKnown_) learnUsed();
    const auto* known = find(id);
    return known && known->used;
}

// ------------------------------------------------------------------ files

bool LayersState::isLayerOutdated(const std::string& id) {
    const auto* known = find(id);
    return known && known->outdated;
}

std::vector<std::string> LayersState::outdatedLayerIdentifiers(Which which, bool notAuto) {
    if (!structureKnown_) learnStructure();
    std::vector<std::string> ids;
    for (const auto& id : used_) {
        const auto& known = known_[id];
        if (!known.outdated || (notAuto && isAutoReloaded(id, known))) continue;
        if (which == Which::All || (which == Which::Sublayers) == known.local) ids.push_back(id);
    }
    return ids;
}

LayerResult<void> LayersState::reloadOutdatedLayers(Which which, bool notAuto) {
    const auto ids = outdatedLayerIdentifiers(which, notAuto);
    if (ids.empty()) return {};
    const bool read = reload(ids);
    context_.events.push(LayerEventType::OutdateStateChanged, ids);
    if (read) return {};
    return fail(LayerErrorType::NotFound, "not all outdated layers can be read");
}

/// Asks the server to reload a live layer; the server reports when it is up to date.
bool LayersState::reload(const std::vector<std::string>& ids) {
    std::vector<std::string> files;
    for (const auto& id : ids) {
        auto* known = find(id);
        if (!known) continue;
        if (context_.live && context_.live->state(known->layer)) {
            context_.live->reload(known->layer);
        } else {
            files.push_back(id);
        }
    }
    if (!files.empty() && !LayerUtils::reloadLayers(files)) return false;
    for (const auto& id : files) {
        auto* known = find(id);
        if (!known) continue;
        if (!known->layer) continue;
        watch_->accept(known->layer->GetRealPath());
        known->outdated = false;
    }
    return true;
}

void LayersState::fileAgrees(const pxr::SdfLayerHandle& layer) {
    if (!layer || layer->IsAnonymous()) return;
    const auto found = known_.find(layer->GetIdentifier());
    if (found == known_.end()) return;
    watch_->accept(layer->GetRealPath());
    if (std::exchange(found->second.outdated, false))
        context_.events.push(LayerEventType::OutdateStateChanged, {layer->GetIdentifier()});
}

void LayersState::watch(double nowMs) {
    followMuteness();
    followEdits();
    if (nowMs < nextLookMs_) return;
    nextLookMs_ = nowMs + kLookEveryMs;
    const auto before = used_;
    learnStructure();
    if (before != used_) context_.events.push(LayerEventType::UsedLayersChanged);
    look(nowMs);
    nextLookMs_ = nowMs + kLookEveryMs;
}

void LayersState::look(double) {
    std::vector<std::string> outdated, permission, reload, dirty;
    for (auto& [id, known] : known_) {
        if (!known.layer || known.layer->IsAnonymous()) continue;
        if (const auto live = liveState(known)) {
            // Its local file is a placeholder.
            if (std::exchange(known.readOnly, !live->writable) == live->writable)
                permission.push_back(id);
            // An edit that the server refused never makes its state dirty.
            if (std::exchange(known.acknowledged, !live->pending) && !live->pending)
                known.editedAt.reset();
            if (followDirtiness(known, *live)) dirty.push_back(id);
            if (std::exchange(known.outdated, live->outdated) != live->outdated) {
                outdated.push_back(id);
                if (live->outdated && isAutoReloaded(id, known)) reload.push_back(id);
            }
            continue;
        }
        const auto seen = watch_->look(known.layer->GetRealPath());
        if (std::exchange(known.readOnly, seen.readOnly) != seen.readOnly) permission.push_back(id);
        known.owner = seen.owner;
        if (std::exchange(known.outdated, seen.changed) != seen.changed) outdated.push_back(id);
        if (seen.changed && isAutoReloaded(id, known)) reload.push_back(id);
    }
    if (!dirty.empty()) context_.events.push(LayerEventType::DirtyStateChanged, std::move(dirty));
    if (!outdated.empty())
        context_.events.push(LayerEventType::OutdateStateChanged, std::move(outdated));
    if (!permission.empty())
        context_.events.push(LayerEventType::LayerFilePermissionChanged, std::move(permission));
    if (!reload.empty()) this->reload(reload);
}

// ------------------------------------------------------------------ auto reload

bool LayersState::isAutoReloaded(const std::string& id, const Known& known) const {
    return autoReload_.contains(id) ||
           (known.local ? autoReloadKinds_.sublayers : autoReloadKinds_.nonSublayers);
}

bool LayersState::isAutoReloadLayer(const std::string& id) {
    if (!usedKnown_) learnUsed();
    const auto* known = find(id);
    return known && known->used && isAutoReloaded(id, *known);
}

void LayersState::setAutoReload(AutoReload kinds) {
    if (std::exchange(autoReloadKinds_, kinds) == kinds) return;
    reloadAutomatically();
}

LayerResult<LayersState::Outcome> LayersState::addAutoReloadLayer(const std::string& id) {
    if (!usedKnown_) learnUsed();
    if (auto unknown = whyUnknown(id)) return tl::unexpected(std::move(*unknown));
    const auto* known = find(id);
    if (!known->used)
        return fail(LayerErrorType::NotFound, "the stage does not use the layer " + id + " now");
    if (!autoReload_.insert(id).second) return Outcome::Unchanged;
    context_.events.push({LayerEventType::AutoReloadLayersChanged, id, {}, {}, {}});
    if (known->outdated) reloadAutomatically();
    return Outcome::Changed;
}

/// Files are reloaded with the next check, which follows soon.
void LayersState::reloadAutomatically() {
    nextLookMs_ = 0;
    std::vector<std::string> live;
    for (const auto& [id, known] : known_)
        if (known.outdated && isAutoReloaded(id, known) && context_.live &&
            context_.live->state(known.layer))
            live.push_back(id);
    if (!live.empty()) reload(live);
}

LayersState::Outcome LayersState::removeAutoReloadLayer(const std::string& id) {
    if (autoReload_.erase(id) == 0) return Outcome::Unchanged;
    context_.events.push({LayerEventType::AutoReloadLayersChanged, id, {}, {}, {}});
    return Outcome::Changed;
}

std::vector<std::string> LayersState::autoReloadLayers() const {
    return {autoReload_.begin(), autoReload_.end()};
}

}  // namespace usdlive::layers
