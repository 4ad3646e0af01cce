// Declares Prototypes, which records the instances of a stage and the prototypes that they share.
#pragma once

#include <pxr/usd/pcp/instanceKey.h>

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <unordered_map>
#include <vector>

#include "usd/stage/Clips.h"
#include "usd/stage/PrimNode.h"
#include "usdlive/client/usd/stage/LoadRules.h"
#include "usdlive/client/usd/stage/PopulationMask.h"

namespace usdlive::stage {

/// The key of a prototype. Prims with equal arcs, load rules, masks and value clips share the prims
/// below them.
struct InstanceKey {
    pxr::PcpInstanceKey arcs;
    LoadRules load;
    PopulationMask mask;
    std::vector<ClipDefinition> clips;

    bool operator==(const InstanceKey&) const = default;
};

struct Prototype {
    pxr::SdfPath path;  // for example "/__Prototype_1"
    InstanceKey key;
    pxr::SdfPath source;  // the instance whose prim indexes it shows; empty until one is chosen
    std::set<pxr::SdfPath> instances;  // the paths of their prim indexes
    PrimNodePtr root;
};

/// Several threads report instances while prims are composed. assignSources() then assigns each
/// instance to its prototype. The first instance of a new prototype becomes the source, so that its
/// children are composed in the same pass.
class Prototypes {
public:
    /// Records an instance; several threads may call it at once. Returns true if the instance is a
    /// source, so that its children must be composed.
    bool found(const pxr::SdfPath& index, InstanceKey key);
    /// Removes the instances at and below a path. A prototype keeps its source if that is found
    /// again. Otherwise assignSources() selects another one: of the instances that the prototype
    /// had before, or else of the new ones, as pxr.Usd does. Instances with equal keys can differ
    /// below.
    void forget(const pxr::SdfPath& prefix);
    /// Assigns all recorded instances to prototypes, and adds prototypes with a new source to
    /// `changed`. Returns sources whose children are not composed yet. Composing them may find more
    /// instances.
    [[nodiscard]] pxr::SdfPathVector assignSources(std::set<Prototype*>& changed);
    /// Changes the key of a prototype. Returns false if another prototype has the new key; nothing
    /// changes then.
    bool rekey(Prototype& prototype, const InstanceKey& key);
    /// Removes the prototypes without instances and returns them.
    [[nodiscard]] std::vector<std::unique_ptr<Prototype>> takeUnused();

    /// Returns the prototype of the instance with this prim index, or null.
    [[nodiscard]] Prototype* of(const pxr::SdfPath& index) const;
    /// Returns the prototype of the nearest instance above a prim index, or null if there is none.
    /// The prototype shows that index only if the instance is its source.
    [[nodiscard]] Prototype* around(const pxr::SdfPath& index) const;
    /// Returns the prototypes whose sources are at or below `prefix`.
    [[nodiscard]] std::vector<Prototype*> sourcedUnder(const pxr::SdfPath& prefix) const;
    [[nodiscard]] Prototype* at(const pxr::SdfPath& path) const;
    [[nodiscard]] const std::vector<std::unique_ptr<Prototype>>& all() const { return all_; }

private:
    Prototype& forKey(const InstanceKey& key);
    void giveSource(Prototype& prototype, const pxr::SdfPath& source);
    void leave(Prototype& prototype, const pxr::SdfPath& instance);

    std::mutex mutex_;  // guards all that found() reads and writes
    std::vector<std::pair<pxr::SdfPath, Prototype*>> found_;
    std::set<Prototype*> changed_;  // prototypes with a new source

    std::vector<std::unique_ptr<Prototype>> all_;  // in the order of creation
    std::unordered_multimap<pxr::PcpInstanceKey, Prototype*, pxr::PcpInstanceKey::Hash> byArcs_;
    std::map<pxr::SdfPath, Prototype*> byInstance_, bySource_;
    std::map<Prototype*, pxr::SdfPath> sourceless_;  // with their previous source
    std::map<pxr::SdfPath, Prototype*> forgotten_;   // instances, until assignSources()
    std::size_t created_ = 0;
};

}  // namespace usdlive::stage
