// Restores locked specs, and removes what was added to locked prims.
#include "usd/layers/LockEnforcement.h"

#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>

#include <algorithm>
#include <utility>

#include "usd/content/SpecEdits.h"
#include "usd/layers/LayersContext.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::layers {

using pxr::SdfLayerHandle;
using pxr::SdfPath;

LockEnforcement::LockEnforcement(LayersContext& context, const SpecLockTable& locks)
    : context_(context), locks_(locks) {}

// ------------------------------------------------------------------ rules

std::optional<LayerError> LockEnforcement::whyLocked(const SdfPath& spec) const {
    const auto& locks = locks_.inEffect();
    if (locks.empty()) return std::nullopt;
    const SdfPath path = spec.StripAllVariantSelections();
    auto found = locks.find(path);
    if (found == locks.end())
        if (const auto addition = additionAt(path)) found = locks.find(addition->GetParentPath());
    if (found == locks.end()) return std::nullopt;
    const auto by = found->second.empty() ? std::string() : " by " + found->second.value;
    return LayerError{LayerErrorType::ReadOnly, found->first.GetString() + " is locked" + by};
}

std::optional<SdfPath> LockEnforcement::additionAt(const SdfPath& path) const {
    for (const SdfPath& one : path.GetPrefixes()) {
        const bool property = one.IsPrimPropertyPath();
        if ((!property && !one.IsPrimPath()) || locks_.holds(one) || locks_.isReleased(one))
            continue;
        const SdfPath parent = one.GetParentPath();
        if (!locks_.holds(parent) || hadSpec(one)) continue;
        if (property || !takesChildren(parent)) return one;
    }
    return std::nullopt;
}

// In our own layers the shadows have the earlier content. Content from arcs was not edited here.
bool LockEnforcement::hadSpec(const SdfPath& path) const {
    const auto inShadow = [this](const SdfPath& there) {
        return std::ranges::any_of(shadows_,
                                   [&](const auto& entry) { return entry.second.has(there); });
    };
    const SdfPath prim = path.GetPrimPath();
    for (const auto& [site, foreign] : context_.stack.sites(prim)) {
        const SdfPath there = path.ReplacePrefix(prim, site, false);
        if (!foreign) {
            if (inShadow(there)) return true;
            continue;
        }
        for (const auto& layer : foreign->GetLayers())
            if (layer->HasSpec(there)) return true;
    }
    return inShadow(path);
}

// A lock of a whole hierarchy is not stored as such. It shows in the locks of all children.
bool LockEnforcement::takesChildren(const SdfPath& prim) const {
    const auto [answer, isNew] = takesChildren_.try_emplace(prim);
    if (isNew)
        answer->second = std::ranges::any_of(context_.host.childNames(prim), [&](const auto& name) {
            const SdfPath child = prim.AppendChild(name);
            return !locks_.holds(child) && hadSpec(child);
        });
    return answer->second;
}

// ------------------------------------------------------------------ shadows

void LockEnforcement::locksAdmitted() {
    takesChildren_.clear();
    shadows_.clear();
    takeShadows();
}

void LockEnforcement::takeShadows() {
    structureKnown_ = true;
    auto before = std::exchange(shadows_, {});
    if (locks_.inEffect().empty()) return;
    for (const auto& one : context_.stack.layers()) {
        if (one.layer == delegate_) continue;
        const std::string& id = one.layer->GetIdentifier();
        if (auto known = before.extract(id))
            shadows_.insert(std::move(known));
        else
            shadows_.try_emplace(id, one.layer, locks_);
    }
}

void LockEnforcement::layerChanged(const SdfLayerHandle& layer, const pxr::SdfChangeList& changes) {
    if (locks_.inEffect().empty()) return;
    const auto found = shadows_.find(layer->GetIdentifier());
    if (found == shadows_.end()) return;
    const bool applied =
        context_.live && context_.live->isApplying() && context_.live->state(layer);
    found->second.note(layer, changes, applied, locks_);
}

// ------------------------------------------------------------------ the frame

void LockEnforcement::beginFrame(const SdfLayerHandle& delegate) {
    delegate_ = delegate;
    takesChildren_.clear();
}

std::vector<RefusedEdit> LockEnforcement::endFrame() {
    if (!structureKnown_) takeShadows();
    return std::exchange(refused_, {});
}

void LockEnforcement::enforce() {
    if (locks_.inEffect().empty() || shadows_.empty()) return;
    for (const auto& one : context_.stack.layers()) {
        const auto found = shadows_.find(one.layer->GetIdentifier());
        if (found != shadows_.end() && one.layer->PermissionToEdit())
            enforceLayer(one.layer, found->second);
    }
}

void LockEnforcement::enforceLayer(const SdfLayerHandle& layer, LockShadow& shadow) {
    auto edits = shadow.takeEdits();
    for (const auto& path : edits.applied) shadow.adopt(layer, path);
    auto& changed = edits.changed;
    for (const auto& path : edits.applied) changed.erase(path);
    // Restores missing specs from the top down, then removes additions from the bottom up.
    for (const auto& path : changed)
        if (!layer->HasSpec(path)) restoreMissing(layer, shadow, edits, path);
    removeAdditions(layer, changed);
    for (auto path = changed.rbegin(); path != changed.rend(); ++path)
        if (layer->HasSpec(*path)) enforceSpec(layer, shadow, *path);
}

void LockEnforcement::removeAdditions(const SdfLayerHandle& layer,
                                      const std::set<SdfPath>& changed) {
    for (const auto& path : changed) {
        if (!layer->HasSpec(path)) continue;
        const SdfPath composed = path.StripAllVariantSelections();
        const auto addition = additionAt(composed);
        if (!addition) continue;
        // Inside a variant the path has another depth, but the same number of names at its end.
        SdfPath there = path;
        for (SdfPath at = composed; at != *addition; at = at.GetParentPath())
            there = there.GetParentPath();
        while (there.IsPrimVariantSelectionPath()) there = there.GetParentPath();
        refuse(layer, there);
        content::removeSpec(layer, there);
    }
}

void LockEnforcement::refuse(const SdfLayerHandle& layer, const SdfPath& path) {
    auto why = whyLocked(path);
    if (!why)
        why = LayerError{LayerErrorType::ReadOnly,
                         "something below " + path.GetString() + " is locked"};
    refused_.push_back({path, "", layer->GetIdentifier(), why->type, why->text});
}

void LockEnforcement::restoreMissing(const SdfLayerHandle& layer, LockShadow& shadow,
                                     const LockShadow::Edits& edits, const SdfPath& path) {
    if (!locks_.hasLockBelow(path.StripAllVariantSelections()))
        shadow.adopt(layer, path);
    else if (!moveBack(layer, shadow, edits, path))
        restoreBelow(layer, shadow, path);
}

// Sdf reports a rename as such. A prim that was moved to another parent is found by its content.
bool LockEnforcement::moveBack(const SdfLayerHandle& layer, LockShadow& shadow,
                               const LockShadow::Edits& edits, const SdfPath& path) {
    SdfPath now;
    if (const auto renamed = edits.renamed.find(path); renamed != edits.renamed.end()) {
        now = renamed->second;
    } else if (shadow.has(path)) {
        const auto moved = std::ranges::find_if(
            edits.added, [&](const SdfPath& added) { return shadow.isLike(layer, added, path); });
        if (moved != edits.added.end()) now = *moved;
    }
    if (now.IsEmpty() || !layer->HasSpec(now) || !layer->HasSpec(path.GetParentPath()))
        return false;
    content::moveSpec(layer, now, path);
    if (!layer->HasSpec(path)) return false;
    refuse(layer, path);
    for (const auto& lock : locks_.below(path))
        if (layer->HasSpec(lock)) enforceSpec(layer, shadow, lock);
    return true;
}

void LockEnforcement::enforceSpec(const SdfLayerHandle& layer, LockShadow& shadow,
                                  const SdfPath& path) {
    const SdfPath composed = path.StripAllVariantSelections();
    if (locks_.holds(composed))
        restore(layer, shadow, path);
    else if (locks_.covers(composed))
        shadow.adopt(layer, path);
}

void LockEnforcement::restore(const SdfLayerHandle& layer, const LockShadow& shadow,
                              const SdfPath& path) {
    if (!shadow.has(path)) return removeStray(layer, path);
    if (shadow.restoreFields(layer, path)) refuse(layer, path);
}

// Restores a spec that is missing in the layer and is locked, or has locked specs below it.
void LockEnforcement::restoreBelow(const SdfLayerHandle& layer, const LockShadow& shadow,
                                   const SdfPath& path) {
    if (locks_.holds(path) && shadow.has(path)) {
        if (shadow.restoreSpec(layer, path)) refuse(layer, path);
        return;
    }
    for (const auto& lock : locks_.below(path)) {
        if (layer->HasSpec(lock) || !shadow.has(lock)) continue;
        if (shadow.restoreSpec(layer, lock)) refuse(layer, lock);
    }
}

// Removes a spec that the layer did not have. Unlocked specs below it stay.
void LockEnforcement::removeStray(const SdfLayerHandle& layer, const SdfPath& path) {
    const auto prim = path.IsPrimPath() ? layer->GetPrimAtPath(path) : pxr::SdfPrimSpecHandle();
    const bool stays = prim && (!prim->GetNameChildren().empty() || !prim->GetProperties().empty());
    if (!stays) {
        content::removeSpec(layer, path);
        return refuse(layer, path);
    }
    bool changed = prim->GetSpecifier() != pxr::SdfSpecifierOver;
    if (changed) prim->SetSpecifier(pxr::SdfSpecifierOver);
    for (const auto& field : layer->ListFields(path)) {
        if (usd::isStructural(field) || field == pxr::SdfFieldKeys->Specifier) continue;
        layer->EraseField(path, field);
        changed = true;
    }
    if (changed) refuse(layer, path);
}

}  // namespace usdlive::layers
