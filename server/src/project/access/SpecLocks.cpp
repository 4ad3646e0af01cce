// Decides about edits of locked specs (LK5).
#include <algorithm>
#include <utility>

#include "project/access/AccessPolicy.h"
#include "usdlive/common/layer/FieldParts.h"
#include "usdlive/common/layer/SpecPath.h"

namespace usdlive::server {

namespace {

/// Returns whether the edit only creates an `over`, which has no opinion and is needed to edit the
/// specs below it. An existing spec that becomes an over is not harmless.
bool isHarmless(const ExecutedEdit& executed, const LayerDoc& before) {
    const auto& [edit, applied] = executed;
    if (std::holds_alternative<CreateSpec>(edit.action)) return true;
    const auto* set = std::get_if<SetField>(&edit.action);
    if (!set || set->field != "specifier") return false;
    return !applied.changed || (makesOver(*set) && !before.has(edit.address.path));
}

bool takesWithAllBelow(const EditAction& action) {
    return std::holds_alternative<DeleteSpec>(action) || std::holds_alternative<MoveSpec>(action);
}

Error lockedError(const std::string& path, const UserName& owner) {
    return {ErrorCode::Locked, path + " is locked" + (owner.empty() ? "" : " by " + owner.value)};
}

}  // namespace

void AccessPolicy::ordered(const OrderedCommit& commit) {
    for (const LayerId& layer : commit.layerData) updateSpecLocks(layer);
}

void AccessPolicy::rolledBack(const Error& /*error*/, const LostCommits& lost) {
    for (const LayerId& layer : lost.changed) updateSpecLocks(layer);
}

void AccessPolicy::loaded(const LayerId& layer, const LoadedLayer& /*loaded*/) {
    updateSpecLocks(layer);
}

void AccessPolicy::failed(const LayerId& layer, const Error& /*error*/) { updateSpecLocks(layer); }

void AccessPolicy::updateSpecLocks(const LayerId& layer) {
    const LayerDocs& docs = facts_->loadedLayers();
    const auto doc = docs.find(layer);
    if (doc == docs.end() || specLocksOf(doc->second).empty())
        lockingRoots_.erase(layer);
    else
        lockingRoots_.insert(layer);
}

bool AccessPolicy::dependsOnEffects(const Subject& subject, const std::vector<Edit>& edits) const {
    if (!lockingRoots_.empty() || areRulesFor(subject)) return true;
    return std::any_of(edits.begin(), edits.end(),
                       [](const Edit& edit) { return touchesSpecLocks(edit.action); });
}

/// Returns the spec locks that apply to a layer: those of each root layer whose local layer stack
/// contains it.
SpecLocks AccessPolicy::specLocksIn(const LayerId& layer, const LayerDocs& before) const {
    const LayerDocs& docs = facts_->loadedLayers();
    SpecLocks locks;
    for (const LayerId& root : lockingRoots_) {
        std::set<LayerId> stack{root};
        std::vector<LayerId> next{root};
        while (!next.empty() && !stack.contains(layer)) {
            const auto doc = docs.find(next.back());
            const LayerId from = std::move(next.back());
            next.pop_back();
            if (doc == docs.end()) continue;
            for (LayerId& sub : subLayersOf(from, doc->second))
                if (stack.insert(sub).second) next.push_back(std::move(sub));
        }
        if (!stack.contains(layer)) continue;
        const auto earlier = before.find(root);
        locks.merge(specLocksOf(earlier == before.end() ? docs.at(root) : earlier->second));
    }
    return locks;
}

bool AccessPolicy::isForeign(const UserName& owner, const Subject& subject) {
    return !subject.isAdministrator() && owner != subject.user;
}

/// Returns an error if another user has locked the spec of the edit, or a spec below it that the
/// edit also affects. `doc` is the layer before the edit.
std::optional<Error> AccessPolicy::specLockOn(const Subject& subject, const Edit& edit,
                                              const SpecLocks& locks, const LayerDoc* doc) {
    const std::string path = withoutVariants(edit.address.path);
    if (const auto lock = locks.find(path); lock != locks.end() && isForeign(lock->second, subject))
        return lockedError(path, lock->second);
    if (!takesWithAllBelow(edit.action) || !doc) return std::nullopt;
    for (auto lock = locks.lower_bound(path); lock != locks.end(); ++lock) {
        if (!lock->first.starts_with(path)) break;
        if (specpath::hasPrefix(lock->first, path) && isForeign(lock->second, subject) &&
            doc->has(lock->first))
            return lockedError(lock->first, lock->second);
    }
    return std::nullopt;
}

bool AccessPolicy::mayPreview(const Subject& subject, const std::vector<Edit>& edits) const {
    const LayerDocs& docs = facts_->loadedLayers();
    const auto docOf = [&](const Edit& edit) -> const LayerDoc* {
        const auto found = docs.find(edit.layer);
        return found == docs.end() ? nullptr : &found->second;
    };
    const bool isByRules = areRulesFor(subject);
    for (const Edit& edit : edits) {
        if (toLock(subject, edit.layer)) return false;
        if (!isByRules && subject.role < Role::Editor) return false;
        if (isByRules && !edit.address.creation && toOpinion(subject, edit, docOf(edit)))
            return false;
    }
    if (lockingRoots_.empty()) return true;
    std::map<LayerId, SpecLocks> known;
    return std::none_of(edits.begin(), edits.end(), [&](const Edit& edit) {
        if (edit.address.creation || edit.address.path == "/") return false;
        const LayerDoc* doc = docOf(edit);
        const auto* set = std::get_if<SetField>(&edit.action);
        const bool isNew = !doc || !doc->has(edit.address.path);
        if (std::holds_alternative<CreateSpec>(edit.action) || (set && isNew && makesOver(*set)))
            return false;
        const auto [entry, added] = known.try_emplace(edit.layer);
        if (added) entry->second = specLocksIn(edit.layer, {});
        return specLockOn(subject, edit, entry->second, doc).has_value();
    });
}

std::optional<std::pair<std::size_t, Error>> AccessPolicy::toEdits(
    const Subject& subject, const std::vector<ExecutedEdit>& executed,
    const LayerDocs& before) const {
    std::map<LayerId, SpecLocks> known;
    const bool isByRules = areRulesFor(subject);
    for (std::size_t index = 0; index < executed.size(); ++index) {
        const Edit& edit = executed[index].edit;
        if (isByRules) {
            auto denied = toOpinion(subject, edit, &before.at(edit.layer));
            if (!denied && edit.address.path == "/" && touchesLayerData(edit.action) &&
                !projectActionOf("/", edit.action))
                denied = toChangedLocks(subject, edit.layer, before.at(edit.layer));
            if (denied) return std::pair(index, *std::move(denied));
        }
        const auto [entry, added] = known.try_emplace(edit.layer);
        if (added) entry->second = specLocksIn(edit.layer, before);
        const SpecLocks& locks = entry->second;
        if (locks.empty() || edit.address.path == "/" ||
            isHarmless(executed[index], before.at(edit.layer)))
            continue;
        if (auto locked = specLockOn(subject, edit, locks, &before.at(edit.layer)))
            return std::pair(index, *std::move(locked));
    }
    if (auto locked = toSpecLocks(subject, before))
        return std::pair(executed.size() - 1, *std::move(locked));
    return std::nullopt;
}

/// Decides about edits of the spec locks themselves.
std::optional<Error> AccessPolicy::toSpecLocks(const Subject& subject,
                                               const LayerDocs& before) const {
    for (const auto& [layer, doc] : before) {
        const SpecLocks were = specLocksOf(doc);
        const SpecLocks are = specLocksOf(facts_->loadedLayers().at(layer));
        if (were == are) continue;
        for (const auto& [path, owner] : were) {
            const auto now = are.find(path);
            const bool stays = now != are.end() && now->second == owner;
            if (stays || !isForeign(owner, subject)) continue;
            if (auto locked =
                    toTakeOver(subject, layer, {true, owner, 0}, lockedError(path, owner)))
                return locked;
        }
        for (const auto& [path, owner] : are)
            if (!were.contains(path) && !owner.empty() && isForeign(owner, subject))
                return Error{ErrorCode::Locked, "users lock in their own name only, and " +
                                                    subject.user.value + " is not " + owner.value};
    }
    return std::nullopt;
}

}  // namespace usdlive::server
