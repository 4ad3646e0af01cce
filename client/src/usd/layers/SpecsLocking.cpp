// Keeps the locks of specs and takes back edits of locked specs.
#include "usdlive/client/usd/layers/SpecsLocking.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/sdf/changeBlock.h>
#include <pxr/usd/sdf/copyUtils.h>
#include <pxr/usd/sdf/primSpec.h>

#include <algorithm>
#include <utility>

#include "usd/content/MappedValue.h"
#include "usd/content/SpecEdits.h"
#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"
#include "usd/layers/SpecPaths.h"
#include "usdlive/client/usd/layers/LiveLayers.h"
#include "usdlive/common/usd/SdfLayerStore.h"

namespace usdlive::layers {

using content::isListOp;
using content::moveSpec;
using content::removeSpec;
using content::setListOp;
using pxr::SdfLayerHandle;
using pxr::SdfPath;

namespace {

const std::string kLocks = "specs_locking";

// Copies the spec's own fields from `from` to `to`. Returns true if a field differed.
bool copyFields(const SdfLayerHandle& from, const SdfLayerHandle& to, const SdfPath& path) {
    bool changed = false;
    auto fields = from->ListFields(path);
    for (const auto& field : to->ListFields(path))
        if (std::ranges::find(fields, field) == fields.end()) fields.push_back(field);
    for (const auto& field : fields) {
        if (usd::isStructural(field)) continue;
        const auto value = from->GetField(path, field), present = to->GetField(path, field);
        if (value == present) continue;
        changed = true;
        if (isListOp(value) || isListOp(present))
            setListOp(to, path, field, value);
        else if (value.IsEmpty())
            to->EraseField(path, field);
        else
            to->SetField(path, field, value);
    }
    return changed;
}

// Returns true if both specs have the same content, including everything below.
bool isLike(const SdfLayerHandle& one, const SdfPath& there, const SdfLayerHandle& other,
            const SdfPath& path) {
    std::vector<SdfPath> specs;
    other->Traverse(path, [&](const SdfPath& spec) { specs.push_back(spec); });
    std::size_t count = 0;
    one->Traverse(there, [&](const SdfPath&) { ++count; });
    return count == specs.size() && std::ranges::all_of(specs, [&](const SdfPath& spec) {
               const SdfPath mine = spec.ReplacePrefix(path, there);
               if (!one->HasSpec(mine)) return false;
               const auto fields = other->ListFields(spec);
               return fields.size() == one->ListFields(mine).size() &&
                      std::ranges::all_of(fields, [&](const auto& field) {
                          return other->GetField(spec, field) == one->GetField(mine, field);
                      });
           });
}

bool copySpec(const SdfLayerHandle& from, const SdfLayerHandle& to, const SdfPath& path) {
    const SdfPath parent = path.GetParentPath();
    if (parent.IsPrimPath() && !to->HasSpec(parent) && !pxr::SdfJustCreatePrimInLayer(to, parent))
        return false;
    return pxr::SdfCopySpec(from, path, to, path);
}

}  // namespace

SpecsLocking::SpecsLocking(LayersContext& context, UserName user)
    : context_(context), user_(std::move(user)) {
    dataChanged();
    admit();
}

SpecsLocking::~SpecsLocking() = default;

// ------------------------------------------------------------------ locks

LayerResult<SpecsLocking::Paths> SpecsLocking::lockSpec(const SdfPath& path, bool hierarchy) {
    const auto specs = specsOf(context_.host, path, hierarchy);
    if (!specs) return tl::unexpected(specs.error());
    Table changed = all();
    const UserName owner = context_.live ? context_.live->user() : user_;
    for (const auto& one : *specs) changed.emplace(one, owner);
    return change(std::move(changed));
}

SpecsLocking::Unlocked SpecsLocking::unlockSpec(const SdfPath& path, bool hierarchy) {
    if (!path.IsAbsolutePath())
        return {{},
                LayerError{LayerErrorType::InvalidParam,
                           "'" + path.GetString() + "' is not the path of a spec"}};
    auto result = unlock([&](const SdfPath& lock) {
        if (lock == path) return true;
        if (hierarchy) return lock.HasPrefix(path);
        return lock.IsPropertyPath() && lock.GetPrimPath() == path;
    });
    // A lock can outlive its spec.
    if (result.specs.empty() && !result.refused)
        if (const auto specs = specsOf(context_.host, path, false); !specs)
            result.refused = specs.error();
    return result;
}

// Skips the locks of others, because one of them would make the server refuse the whole edit.
template <class Chosen>
SpecsLocking::Unlocked SpecsLocking::unlock(Chosen chosen) {
    Table changed = all();
    std::optional<LayerError> held;
    std::erase_if(changed, [&](const auto& lock) {
        if (!chosen(lock.first)) return false;
        if (!isForeign(lock.second)) return true;
        held = LayerError{LayerErrorType::ReadOnly,
                          lock.first.GetString() + " is locked by " + lock.second.value +
                              ". Only they or an administrator of the server can unlock it"};
        return false;
    });
    auto unlocked = change(std::move(changed));
    if (!unlocked) return {{}, held ? std::move(held) : std::move(unlocked.error())};
    return {std::move(*unlocked), std::move(held)};
}

bool SpecsLocking::isForeign(const UserName& owner) const {
    return !owner.empty() && context_.live && owner != context_.live->user() &&
           context_.live->state(context_.host.rootLayer());
}

SpecsLocking::Table SpecsLocking::all() const {
    Table locks = locks_;
    locks.insert(incoming_.begin(), incoming_.end());
    return locks;
}

SpecsLocking::Unlocked SpecsLocking::unlockAllSpecs() {
    return unlock([](const SdfPath&) { return true; });
}

SpecsLocking::Paths SpecsLocking::allLockedSpecs() const {
    Paths paths;
    for (const auto& [path, owner] : all()) paths.push_back(path);
    return paths;
}

bool SpecsLocking::isSpecLocked(const SdfPath& path) const {
    return locks_.contains(path) || incoming_.contains(path);
}

std::optional<LayerError> SpecsLocking::whyLocked(const SdfPath& spec) const {
    if (locks_.empty()) return std::nullopt;
    const SdfPath path = spec.StripAllVariantSelections();
    auto found = locks_.find(path);
    if (found == locks_.end())
        if (const auto addition = additionAt(path)) found = locks_.find(addition->GetParentPath());
    if (found == locks_.end()) return std::nullopt;
    const auto by = found->second.empty() ? std::string() : " by " + found->second.value;
    return LayerError{LayerErrorType::ReadOnly, found->first.GetString() + " is locked" + by};
}

std::optional<SdfPath> SpecsLocking::additionAt(const SdfPath& path) const {
    for (const SdfPath& one : path.GetPrefixes()) {
        const bool property = one.IsPrimPropertyPath();
        if ((!property && !one.IsPrimPath()) || locks_.contains(one) || released_.contains(one))
            continue;
        const SdfPath parent = one.GetParentPath();
        if (!locks_.contains(parent) || hadSpec(one)) continue;
        if (property || !takesChildren(parent)) return one;
    }
    return std::nullopt;
}

// In our own layers the shadows have the earlier content. Content from arcs was not edited here.
bool SpecsLocking::hadSpec(const SdfPath& path) const {
    const SdfPath prim = path.GetPrimPath();
    for (const auto& [site, foreign] : context_.stack.sites(prim)) {
        const SdfPath there = path.ReplacePrefix(prim, site, false);
        if (foreign) {
            for (const auto& layer : foreign->GetLayers())
                if (layer->HasSpec(there)) return true;
            continue;
        }
        for (const auto& [id, shadow] : shadows_)
            if (shadow.content->HasSpec(there)) return true;
    }
    return std::ranges::any_of(
        shadows_, [&](const auto& entry) { return entry.second.content->HasSpec(path); });
}

// A lock of a whole hierarchy is not stored as such. It shows in the locks of all children.
bool SpecsLocking::takesChildren(const SdfPath& prim) const {
    const auto [answer, isNew] = takesChildren_.try_emplace(prim);
    if (isNew)
        answer->second = std::ranges::any_of(context_.host.childNames(prim), [&](const auto& name) {
            const SdfPath child = prim.AppendChild(name);
            return !locks_.contains(child) && hadSpec(child);
        });
    return answer->second;
}

LayerResult<SpecsLocking::Paths> SpecsLocking::change(Table changed) {
    Paths paths;
    const Table before = all();
    for (const auto& [path, owner] : changed)
        if (!before.contains(path)) paths.push_back(path);
    for (const auto& [path, owner] : before)
        if (!changed.contains(path)) paths.push_back(path);
    if (paths.empty()) return paths;
    const auto root =
        context_.live ? context_.live->state(context_.host.rootLayer()) : std::nullopt;
    if (root && isForeign(root->lockHolder))
        return fail(LayerErrorType::ReadOnly,
                    "the root layer, which stores the locks of specs, is locked by " +
                        root->lockHolder.value);
    pxr::VtDictionary stored;
    for (const auto& [path, owner] : changed) stored[path.GetString()] = pxr::VtValue(owner.value);
    const pxr::SdfChangeBlock block;
    enforceAll();  // under the locks at the time of the edits
    changing_ = true;
    const bool kept = setOmniDictionary(context_.host.rootLayer(), kLocks, std::move(stored));
    changing_ = false;
    if (!kept)
        return fail(LayerErrorType::ReadOnly,
                    "the root layer, which stores the locks of specs, accepts no edits");
    follow(std::move(changed));
    admit();
    return paths;
}

void SpecsLocking::dataChanged() {
    if (changing_) return;
    Table stored;
    for (const auto& [path, owner] : omniDictionary(context_.host.rootLayer(), kLocks))
        if (SdfPath::IsValidPathString(path))
            stored[SdfPath(path)] = UserName{owner.GetWithDefault<std::string>()};
    follow(std::move(stored));
}

// Writes nothing, because it may be called inside a notice.
void SpecsLocking::follow(Table locks) {
    const Table now = all();
    if (locks == now) return;
    LayerEvent event;
    event.type = LayerEventType::SpecsLockingChanged;
    for (const auto& [path, owner] : locks)
        if (!now.contains(path)) event.paths.push_back(path);
    for (const auto& [path, owner] : now)
        if (!locks.contains(path)) event.paths.push_back(path);
    if (!event.paths.empty()) context_.events.push(std::move(event));
    for (const auto& [path, owner] : locks) released_.erase(path);
    for (const auto& [path, owner] : now)
        if (path.IsPropertyPath() && !locks.contains(path) && locks.contains(path.GetPrimPath()))
            released_.insert(path);
    // An edit in the same frame as its unlock stays. A new lock protects the content after the
    // frame's edits.
    std::erase_if(locks_, [&](const auto& lock) { return !locks.contains(lock.first); });
    incoming_ = std::move(locks);
    std::erase_if(incoming_, [&](const auto& lock) { return locks_.contains(lock.first); });
}

void SpecsLocking::admit() {
    if (incoming_.empty()) return;
    takesChildren_.clear();
    locks_.merge(incoming_);
    incoming_.clear();
    shadows_.clear();
    takeShadows();
}

// ------------------------------------------------------------------ shadows

bool SpecsLocking::covers(const SdfPath& path) const {
    if (locks_.contains(path)) return true;
    for (SdfPath prim = path.GetPrimPath(); prim.IsPrimPath(); prim = prim.GetParentPath())
        if (locks_.contains(prim)) return true;
    return false;
}

bool SpecsLocking::hasLockBelow(const SdfPath& path) const {
    const auto first = locks_.lower_bound(path);
    return first != locks_.end() && first->first.HasPrefix(path);
}

void SpecsLocking::structureChanged() { structureKnown_ = false; }

void SpecsLocking::takeShadows() {
    structureKnown_ = true;
    auto before = std::exchange(shadows_, {});
    if (locks_.empty()) return;
    for (const auto& one : context_.stack.layers()) {
        if (one.layer == delegate_) continue;
        const std::string& id = one.layer->GetIdentifier();
        auto& shadow = shadows_[id];
        if (const auto known = before.find(id); known != before.end())
            shadow = std::move(known->second);
        else
            takeShadow(one.layer, shadow);
    }
}

void SpecsLocking::takeShadow(const SdfLayerHandle& layer, Shadow& shadow) {
    shadow = {};
    shadow.content = pxr::SdfLayer::CreateAnonymous(".usda");
    SdfPath top;
    for (const auto& [path, owner] : locks_) {
        // Sorted: specs below a locked prim are copied with it.
        if (!top.IsEmpty() && path.HasPrefix(top)) continue;
        if (path.IsPrimPath()) top = path;
        if (layer->HasSpec(path)) copySpec(layer, shadow.content, path);
    }
}

void SpecsLocking::layerChanged(const SdfLayerHandle& layer, const pxr::SdfChangeList& changes) {
    if (locks_.empty()) return;
    const auto found = shadows_.find(layer->GetIdentifier());
    if (found == shadows_.end()) return;
    auto& shadow = found->second;
    const bool applied =
        context_.live && context_.live->isApplying() && context_.live->state(layer);
    for (const auto& [path, entry] : changes.GetEntryList()) {
        if (entry.flags.didReplaceContent) {
            takeShadow(layer, shadow);
            return;
        }
        const SdfPath spec =
            path.ContainsTargetPath() ? path.GetPrimOrPrimVariantSelectionPath() : path;
        if (spec == SdfPath::AbsoluteRootPath()) continue;
        const SdfPath composed = spec.StripAllVariantSelections();
        auto& noted = applied ? shadow.applied : shadow.changed;
        if (covers(composed) || hasLockBelow(composed)) noted.insert(spec);
        if (entry.flags.didRename) noted.insert(entry.oldPath);
        if (applied) continue;
        if (entry.flags.didRename) shadow.renamed[entry.oldPath] = path;
        if (entry.flags.didAddInertPrim || entry.flags.didAddNonInertPrim)
            shadow.added.insert(path);
    }
}

// ------------------------------------------------------------------ taking back

std::vector<RefusedEdit> SpecsLocking::update(const SdfLayerHandle& delegate) {
    delegate_ = delegate;
    takesChildren_.clear();
    enforceAll();
    admit();
    if (!structureKnown_) takeShadows();
    return std::exchange(refused_, {});
}

void SpecsLocking::enforceAll() {
    if (locks_.empty() || shadows_.empty()) return;
    for (const auto& one : context_.stack.layers()) {
        const auto found = shadows_.find(one.layer->GetIdentifier());
        if (found != shadows_.end() && one.layer->PermissionToEdit())
            enforceLayer(one.layer, found->second);
    }
}

void SpecsLocking::enforceLayer(const SdfLayerHandle& layer, Shadow& shadow) {
    const auto applied = std::exchange(shadow.applied, {});
    for (const auto& path : applied) adopt(layer, shadow, path);
    auto changed = std::exchange(shadow.changed, {});
    for (const auto& path : applied) changed.erase(path);
    // Restores missing specs from the top down, then removes additions from the bottom up.
    for (const auto& path : changed)
        if (!layer->HasSpec(path)) restoreMissing(layer, shadow, path);
    removeAdditions(layer, changed);
    for (auto path = changed.rbegin(); path != changed.rend(); ++path)
        if (layer->HasSpec(*path)) enforce(layer, shadow, *path);
    shadow.renamed.clear();
    shadow.added.clear();
}

void SpecsLocking::adopt(const SdfLayerHandle& layer, Shadow& shadow, const SdfPath& path) {
    if (layer->HasSpec(path) && shadow.content->HasSpec(path))
        copyFields(layer, shadow.content, path);
    else if (layer->HasSpec(path))
        copySpec(layer, shadow.content, path);
    else if (shadow.content->HasSpec(path))
        removeSpec(shadow.content, path);
}

void SpecsLocking::removeAdditions(const SdfLayerHandle& layer, const std::set<SdfPath>& changed) {
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
        removeSpec(layer, there);
    }
}

void SpecsLocking::refuse(const SdfLayerHandle& layer, const SdfPath& path) {
    auto why = whyLocked(path);
    if (!why)
        why = LayerError{LayerErrorType::ReadOnly,
                         "something below " + path.GetString() + " is locked"};
    refused_.push_back({path, "", layer->GetIdentifier(), why->type, why->text});
}

void SpecsLocking::restoreMissing(const SdfLayerHandle& layer, Shadow& shadow,
                                  const SdfPath& path) {
    if (hasLockBelow(path.StripAllVariantSelections())) {
        if (!moveBack(layer, shadow, path)) restoreBelow(layer, shadow, path);
        return;
    }
    if (shadow.content->HasSpec(path)) removeSpec(shadow.content, path);
}

// Sdf reports a rename as such. A prim that was moved to another parent is found by its content.
bool SpecsLocking::moveBack(const SdfLayerHandle& layer, Shadow& shadow, const SdfPath& path) {
    SdfPath now;
    if (const auto renamed = shadow.renamed.find(path); renamed != shadow.renamed.end()) {
        now = renamed->second;
    } else if (shadow.content->HasSpec(path)) {
        const auto moved = std::ranges::find_if(shadow.added, [&](const SdfPath& added) {
            return isLike(layer, added, shadow.content, path);
        });
        if (moved != shadow.added.end()) now = *moved;
    }
    if (now.IsEmpty() || !layer->HasSpec(now) || !layer->HasSpec(path.GetParentPath()))
        return false;
    moveSpec(layer, now, path);
    if (!layer->HasSpec(path)) return false;
    refuse(layer, path);
    for (auto lock = locks_.lower_bound(path); lock != locks_.end() && lock->first.HasPrefix(path);
         ++lock)
        if (layer->HasSpec(lock->first)) enforce(layer, shadow, lock->first);
    return true;
}

void SpecsLocking::enforce(const SdfLayerHandle& layer, Shadow& shadow, const SdfPath& path) {
    const SdfPath composed = path.StripAllVariantSelections();
    if (locks_.contains(composed)) {
        restore(layer, shadow, path);
    } else if (covers(composed)) {
        if (shadow.content->HasSpec(path))
            copyFields(layer, shadow.content, path);
        else
            copySpec(layer, shadow.content, path);
    }
}

void SpecsLocking::restore(const SdfLayerHandle& layer, const Shadow& shadow, const SdfPath& path) {
    if (!shadow.content->HasSpec(path)) return removeStray(layer, path);
    if (copyFields(shadow.content, layer, path)) refuse(layer, path);
}

// Restores a spec that is missing in the layer and is locked, or has locked specs below it.
void SpecsLocking::restoreBelow(const SdfLayerHandle& layer, const Shadow& shadow,
                                const SdfPath& path) {
    if (locks_.contains(path) && shadow.content->HasSpec(path)) {
        if (copySpec(shadow.content, layer, path)) refuse(layer, path);
        return;
    }
    for (auto lock = locks_.lower_bound(path); lock != locks_.end() && lock->first.HasPrefix(path);
         ++lock) {
        if (layer->HasSpec(lock->first) || !shadow.content->HasSpec(lock->first)) continue;
        if (copySpec(shadow.content, layer, lock->first)) refuse(layer, lock->first);
    }
}

// Removes a spec that the layer did not have. Unlocked specs below it stay.
void SpecsLocking::removeStray(const SdfLayerHandle& layer, const SdfPath& path) {
    const auto prim = path.IsPrimPath() ? layer->GetPrimAtPath(path) : pxr::SdfPrimSpecHandle();
    const bool stays = prim && (!prim->GetNameChildren().empty() || !prim->GetProperties().empty());
    if (!stays) {
        removeSpec(layer, path);
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
