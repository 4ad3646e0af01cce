// Declares Composition, a PcpCache of a root layer and a session layer that follows their changes.
#pragma once

#include <pxr/usd/ar/resolverContext.h>
#include <pxr/usd/pcp/cache.h>
#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/pcp/layerStackIdentifier.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "usd/stage/DepthGuard.h"

namespace usdlive::stage {

/// Returns the resolver context that a stage of this root layer uses.
[[nodiscard]] pxr::ArResolverContext contextOf(const pxr::SdfLayerHandle& root);

/// A root layer and a session layer, composed by Pcp and kept up to date while the layers change.
/// An edit of a value composes no prim again. An edit of an arc composes only the prims that it
/// reaches.
///
/// Use it on one thread, the one that owns the layers. It keeps the root and session layers in
/// memory.
class Composition {
public:
    /// Selects the payloads that are composed.
    enum class Payloads { None, All };
    /// Selects the prims that are composed in parallel. Several threads call both functions at
    /// once.
    struct Scope {
        /// Returns true if the children of a prim are composed. To compose only some children, it
        /// writes their names to `names`.
        std::function<bool(const pxr::PcpPrimIndex&, pxr::TfTokenVector* names)> children;
        /// Returns true if the payloads of the prim at a path are composed.
        std::function<bool(const pxr::SdfPath&)> payloads;
    };

    /// `session` may be null. `muted` lists the identifiers of layers that are left out.
    Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                const std::vector<std::string>& muted, Payloads payloads);
    Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                const std::vector<std::string>& muted, Scope scope);
    /// Does the same with a resolver context of the caller, and these variant fallbacks.
    Composition(const pxr::PcpLayerStackIdentifier& stack, const std::vector<std::string>& muted,
                Scope scope, const pxr::PcpVariantFallbackMap& fallbacks);
    Composition(const Composition&) = delete;
    Composition& operator=(const Composition&) = delete;

    /// Updates the composition. The owner calls it for each SdfNotice::LayersDidChange on its
    /// thread.
    void follow(const pxr::SdfLayerChangeListVec& changes);
    /// Mutes these layers, and unmutes all others.
    void setMuted(const std::vector<std::string>& muted);
    /// Does the same, and adds the resulting changes to `changes`. The caller then calls apply().
    void setMuted(const std::vector<std::string>& muted, pxr::PcpChanges& changes);
    /// Checks changed layers for input that is too deep, and adds to `changes` what is left out or
    /// composed again because of it. Returns true if it added something. The owner calls it before
    /// it computes other changes of the same notice; follow() calls it itself.
    bool guard(const pxr::SdfLayerChangeListVec& layers, pxr::PcpChanges& changes);
    /// Does the same for the payloads of prims, before they are loaded.
    void guardPayloads(const pxr::SdfPathSet& prims, pxr::PcpChanges& changes);
    /// Removes the names of children that are left out because their arcs lead too deep.
    void dropLeftOut(const pxr::SdfPath& prim, pxr::TfTokenVector& names) const;
    /// Returns true if a prim is left out because it, or a prim that it uses, leads too deep.
    [[nodiscard]] bool leavesOut(const pxr::SdfPath& prim) const { return guard_.leavesOut(prim); }
    /// Returns what is left out because it is too deep.
    [[nodiscard]] const std::vector<DepthGuard::Problem>& depthProblems() const {
        return guard_.problems();
    }
    /// Applies changes that the owner computed itself. It is an alternative to follow().
    void apply(pxr::PcpChanges& changes);
    /// Composes the prims at and below the paths on all cores, within the scope.
    void composeInParallel(const pxr::SdfPathVector& all);
    /// Returns the cache, for code that reads all composed prims or plans edits of them.
    [[nodiscard]] pxr::PcpCache& cache() { return *cache_; }
    [[nodiscard]] const pxr::PcpCache& cache() const { return *cache_; }

    [[nodiscard]] const pxr::PcpLayerStack& localLayers() const;
    /// Returns a number that changes whenever the local layers or their offsets change.
    [[nodiscard]] std::uint64_t localRevision() const { return localRevision_; }

    /// Returns the prim index at a path, and composes it first if necessary. Returns null if `prim`
    /// is not the path of a prim. The pointer is valid until the layers change.
    [[nodiscard]] const pxr::PcpPrimIndex* primIndex(const pxr::SdfPath& prim);
    /// Returns the composed names in order. Returns no names if there is no such prim.
    [[nodiscard]] pxr::TfTokenVector childNames(const pxr::SdfPath& prim);
    [[nodiscard]] pxr::TfTokenVector propertyNames(const pxr::SdfPath& prim);
    /// Returns all layers that contribute. Composes all prims that are not composed yet.
    [[nodiscard]] pxr::SdfLayerHandleSet usedLayers();

    /// Returns how many prims were composed, each as often as it was composed. For measurements and
    /// tests.
    [[nodiscard]] std::size_t primsComposed() const { return primsComposed_; }

private:
    Composition(const pxr::PcpLayerStackIdentifier& stack, const std::vector<std::string>& muted,
                Scope scope, const pxr::PcpVariantFallbackMap& fallbacks,
                DepthGuard::Layers layers);
    const pxr::PcpPrimIndex* compose(const pxr::SdfPath& prim);
    bool composesChildren(const pxr::PcpPrimIndex& index, pxr::TfTokenVector* names) const;
    bool checkAll();
    void leaveOut(pxr::PcpChanges& changes);
    void mute(pxr::PcpChanges* changes);
    void composeAll();

    std::unique_ptr<pxr::PcpCache> cache_;
    std::vector<std::string> muted_;     // by the owner
    std::vector<std::string> allMuted_;  // also by the guard
    const Scope scope_;
    DepthGuard guard_;
    DepthGuard::Opened opened_;  // by the guard, until the prims are composed
    bool complete_ = false;      // true if all prims are composed
    std::uint64_t localRevision_ = 1;
    std::size_t primsComposed_ = 0;
};

}  // namespace usdlive::stage
