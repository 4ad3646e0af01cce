// Reads and writes the locks of specs.
#include "usd/layers/LockedSpecs.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/changeBlock.h>

#include <utility>

#include "usd/layers/LayersContext.h"
#include "usd/layers/OmniLayerData.h"
#include "usd/layers/SpecPaths.h"

namespace usdlive::layers {

using pxr::SdfPath;

namespace {

const std::string kLocks = "specs_locking";

}  // namespace

LockedSpecs::LockedSpecs(LayersContext& context, UserName user)
    : context_(context), user_(std::move(user)), enforcement_(context, table_) {
    dataChanged();
    admit();
}

// ------------------------------------------------------------------ locks

LayerResult<LockedSpecs::Paths> LockedSpecs::lockSpec(const SdfPath& path, bool hierarchy) {
    const auto specs = specsOf(context_.host, path, hierarchy);
    if (!specs) return tl::unexpected(specs.error());
    Locks changed = table_.all();
    const UserName owner = context_.live ? context_.live->user() : user_;
    for (const auto& one : *specs) changed.emplace(one, owner);
    return change(std::move(changed));
}

LockedSpecs::Unlocked LockedSpecs::unlockSpec(const SdfPath& path, bool hierarchy) {
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
LockedSpecs::Unlocked LockedSpecs::unlock(Chosen chosen) {
    Locks changed = table_.all();
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

bool LockedSpecs::isForeign(const UserName& owner) const {
    return !owner.empty() && context_.live && owner != context_.live->user() &&
           context_.live->state(context_.host.rootLayer());
}

LockedSpecs::Unlocked LockedSpecs::unlockAllSpecs() {
    return unlock([](const SdfPath&) { return true; });
}

LockedSpecs::Paths LockedSpecs::allLockedSpecs() const {
    Paths paths;
    for (const auto& [path, owner] : table_.all()) paths.push_back(path);
    return paths;
}

bool LockedSpecs::isSpecLocked(const SdfPath& path) const { return table_.isLocked(path); }

std::optional<LayerError> LockedSpecs::whyLocked(const SdfPath& spec) const {
    return enforcement_.whyLocked(spec);
}

LayerResult<LockedSpecs::Paths> LockedSpecs::change(Locks changed) {
    Paths paths;
    const Locks before = table_.all();
    for (const auto& [path, owner] : changed)
        if (!before.contains(path)) paths.push_back(path);
    for (const auto& [path, owner] : before)
        if (!changed.contains(path)) paths.push_back(path);
    if (paths.empty()) return paths;
    const auto root = context_.liveState(context_.host.rootLayer());
    if (root && isForeign(root->lockHolder))
        return fail(LayerErrorType::ReadOnly,
                    "the root layer, which stores the locks of specs, is locked by " +
                        root->lockHolder.value);
    pxr::VtDictionary stored;
    for (const auto& [path, owner] : changed) stored[path.GetString()] = pxr::VtValue(owner.value);
    const pxr::SdfChangeBlock block;
    enforcement_.enforce();  // under the locks at the time of the edits
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

// ------------------------------------------------------------------ changes

void LockedSpecs::dataChanged() {
    if (changing_) return;
    Locks stored;
    for (const auto& [path, owner] : omniDictionary(context_.host.rootLayer(), kLocks))
        if (SdfPath::IsValidPathString(path))
            stored[SdfPath(path)] = UserName{owner.GetWithDefault<std::string>()};
    follow(std::move(stored));
}

void LockedSpecs::follow(Locks locks) {
    LayerEvent event;
    event.type = LayerEventType::SpecsLockingChanged;
    event.paths = table_.assign(std::move(locks));
    if (!event.paths.empty()) context_.events.push(std::move(event));
}

void LockedSpecs::admit() {
    if (table_.admit()) enforcement_.locksAdmitted();
}

void LockedSpecs::layerChanged(const pxr::SdfLayerHandle& layer,
                               const pxr::SdfChangeList& changes) {
    enforcement_.layerChanged(layer, changes);
}

void LockedSpecs::structureChanged() { enforcement_.structureChanged(); }

std::vector<RefusedEdit> LockedSpecs::update(const pxr::SdfLayerHandle& delegate) {
    enforcement_.beginFrame(delegate);
    enforcement_.enforce();
    admit();
    return enforcement_.endFrame();
}

}  // namespace usdlive::layers
