// Assigns prototypes to instances, and sources to prototypes.
#include "usd/stage/Prototypes.h"

#include <algorithm>
#include <string>
#include <utility>

namespace usdlive::stage {

using pxr::SdfPath;

bool Prototypes::found(const SdfPath& index, InstanceKey key) {
    const std::scoped_lock lock(mutex_);
    auto& prototype = forKey(key);
    found_.emplace_back(index, &prototype);
    const auto waiting = sourceless_.find(&prototype);
    if (waiting != sourceless_.end() && (waiting->second == index || waiting->second.IsEmpty())) {
        giveSource(prototype, index);
        sourceless_.erase(waiting);
    }
    return prototype.source == index;
}

void Prototypes::giveSource(Prototype& prototype, const SdfPath& source) {
    prototype.source = source;
    bySource_[source] = &prototype;
    changed_.insert(&prototype);
}

void Prototypes::leave(Prototype& prototype, const SdfPath& instance) {
    prototype.instances.erase(instance);
    if (prototype.source != instance) return;
    bySource_.erase(instance);
    sourceless_.emplace(&prototype, std::exchange(prototype.source, SdfPath()));
}

void Prototypes::forget(const SdfPath& prefix) {
    auto at = byInstance_.lower_bound(prefix);
    while (at != byInstance_.end() && at->first.HasPrefix(prefix)) {
        leave(*at->second, at->first);
        forgotten_.insert(*at);
        at = byInstance_.erase(at);
    }
}

Prototype& Prototypes::forKey(const InstanceKey& key) {
    const auto [begin, end] = byArcs_.equal_range(key.arcs);
    for (auto at = begin; at != end; ++at)
        if (at->second->key == key) return *at->second;
    auto& prototype = all_.emplace_back(std::make_unique<Prototype>());
    prototype->path = SdfPath("/__Prototype_" + std::to_string(++created_));
    prototype->key = key;
    byArcs_.emplace(key.arcs, prototype.get());
    sourceless_.emplace(prototype.get(), SdfPath());
    return *prototype;
}

pxr::SdfPathVector Prototypes::assignSources(std::set<Prototype*>& changed) {
    const auto forgotten = std::exchange(forgotten_, {});
    std::set<SdfPath> added;
    std::map<Prototype*, SdfPath> firstAdded;
    for (const auto& [path, prototype] : std::exchange(found_, {})) {
        const auto before = forgotten.find(path);
        auto& known = byInstance_[path];
        if (known != prototype && (before == forgotten.end() || before->second != prototype)) {
            added.insert(path);
            firstAdded.try_emplace(prototype, path);
        }
        if (known && known != prototype) leave(*known, path);
        known = prototype;
        prototype->instances.insert(path);
    }
    pxr::SdfPathVector sources;
    for (auto at = sourceless_.begin(); at != sourceless_.end();) {
        auto* prototype = at->first;
        if (prototype->instances.empty()) {
            ++at;
            continue;
        }
        const auto& instances = prototype->instances;
        const auto kept = std::ranges::find_if(
            instances, [&](const SdfPath& one) { return !added.contains(one); });
        giveSource(*prototype, kept == instances.end() ? firstAdded.at(prototype) : *kept);
        sources.push_back(prototype->source);
        at = sourceless_.erase(at);
    }
    changed.merge(std::exchange(changed_, {}));
    std::ranges::sort(sources);
    return sources;
}

bool Prototypes::rekey(Prototype& prototype, const InstanceKey& key) {
    const auto [begin, end] = byArcs_.equal_range(key.arcs);
    for (auto at = begin; at != end; ++at)
        if (at->second->key == key) return false;
    std::erase_if(byArcs_, [&](const auto& one) { return one.second == &prototype; });
    prototype.key = key;
    byArcs_.emplace(key.arcs, &prototype);
    return true;
}

std::vector<std::unique_ptr<Prototype>> Prototypes::takeUnused() {
    std::vector<std::unique_ptr<Prototype>> unused;
    for (auto& prototype : all_) {
        if (!prototype->instances.empty()) continue;
        sourceless_.erase(prototype.get());
        changed_.erase(prototype.get());
        std::erase_if(byArcs_, [&](const auto& one) { return one.second == prototype.get(); });
        unused.push_back(std::move(prototype));
    }
    std::erase(all_, nullptr);
    return unused;
}

Prototype* Prototypes::of(const SdfPath& index) const {
    const auto found = byInstance_.find(index);
    return found == byInstance_.end() ? nullptr : found->second;
}

Prototype* Prototypes::around(const SdfPath& index) const {
    if (byInstance_.empty()) return nullptr;
    for (SdfPath above = index.GetParentPath(); !above.IsEmpty(); above = above.GetParentPath())
        if (auto* prototype = of(above)) return prototype;
    return nullptr;
}

std::vector<Prototype*> Prototypes::sourcedUnder(const SdfPath& prefix) const {
    std::vector<Prototype*> prototypes;
    for (auto at = bySource_.lower_bound(prefix);
         at != bySource_.end() && at->first.HasPrefix(prefix); ++at)
        prototypes.push_back(at->second);
    return prototypes;
}

Prototype* Prototypes::at(const SdfPath& path) const {
    for (const auto& prototype : all_)
        if (prototype->path == path) return prototype.get();
    return nullptr;
}

}  // namespace usdlive::stage
