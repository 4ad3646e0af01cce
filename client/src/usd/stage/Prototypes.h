// Which prims are instances of what.
#pragma once

#include <pxr/usd/pcp/instanceKey.h>

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <unordered_map>
#include <vector>

#include "PrimNode.h"
#include "usdlive/client/usd/stage/LoadRules.h"
#include "usdlive/client/usd/stage/PopulationMask.h"

namespace usdlive::stage {

/// Prims that are composed alike, loaded alike and masked alike share what is below them.
struct InstanceKey {
    pxr::PcpInstanceKey arcs;
    LoadRules load;
    PopulationMask mask;

    bool operator==(const InstanceKey&) const = default;
};

struct Prototype {
    pxr::SdfPath path;  // "/__Prototype_1"
    InstanceKey key;
    pxr::SdfPath source;  // the instance whose prim indexes it shows; empty: to be chosen
    std::set<pxr::SdfPath> instances;  // by prim index
    PrimNodePtr root;
};

/// Instances are found while prims are composed, by several threads; then settle() gives each its
/// prototype. The first one found becomes the source, so that its children are composed at once.
class Prototypes {
public:
    /// Notes an instance. Returns whether its children are to be composed: it is a source.
    bool found(const pxr::SdfPath& index, InstanceKey key);
    /// Forgets the instances at and below a path. Prototypes that lose their source get another
    /// one.
    void forget(const pxr::SdfPath& prefix);
    /// Gives all instances found their prototypes, and adds those that have a new source to
    /// `changed`. Returns sources whose children are not composed yet; composing them may find more
    /// instances.
    [[nodiscard]] pxr::SdfPathVector settle(std::set<Prototype*>& changed);
    /// Drops prototypes without instances, and returns them.
    [[nodiscard]] std::vector<std::unique_ptr<Prototype>> takeUnused();

    /// Of the instance with this prim index; else null.
    [[nodiscard]] Prototype* of(const pxr::SdfPath& index) const;
    /// The prototype in which the prim of this index is: that of the nearest instance above it.
    /// Null: no instance is above it. It shows the index only if that instance is its source.
    [[nodiscard]] Prototype* around(const pxr::SdfPath& index) const;
    /// Prototypes whose sources are at or below `prefix`.
    [[nodiscard]] std::vector<Prototype*> sourcedUnder(const pxr::SdfPath& prefix) const;
    [[nodiscard]] Prototype* at(const pxr::SdfPath& path) const;
    [[nodiscard]] const std::vector<std::unique_ptr<Prototype>>& all() const { return all_; }

private:
    Prototype& forKey(const InstanceKey& key);
    void giveSource(Prototype& prototype, const pxr::SdfPath& source);
    void leave(Prototype& prototype, const pxr::SdfPath& instance);

    std::mutex mutex_;  // guards all that found() reads and writes
    std::vector<std::pair<pxr::SdfPath, Prototype*>> found_;
    std::set<Prototype*> changed_;  // have a new source

    std::vector<std::unique_ptr<Prototype>> all_;  // in the order of creation
    std::unordered_multimap<pxr::PcpInstanceKey, Prototype*, pxr::PcpInstanceKey::Hash> byArcs_;
    std::map<pxr::SdfPath, Prototype*> byInstance_, bySource_;
    std::map<Prototype*, pxr::SdfPath> sourceless_;  // with the source of before
    std::size_t created_ = 0;
};

}  // namespace usdlive::stage
