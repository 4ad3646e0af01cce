#pragma once

#include <pxr/usd/pcp/cache.h>
#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/layerStack.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace usdlive::stage {

/// A root layer and a session layer, composed by Pcp and kept up to date while their layers change:
/// an edit of a value composes nothing again, an edit of an arc only the prims that it reaches.
///
/// One thread, the one that owns the layers. The layers are kept in memory as long as this lives.
class Composition {
public:
    /// Which payloads prims are composed with.
    enum class Payloads { None, All };
    /// Which prims are composed when all are. Both functions are called by several threads at once.
    struct Scope {
        /// Whether the children of a prim are composed; `names` may be filled with the only ones.
        std::function<bool(const pxr::PcpPrimIndex&, pxr::TfTokenVector* names)> children;
        /// Whether the payloads of the prim at a path are.
        std::function<bool(const pxr::SdfPath&)> payloads;
    };

    /// `session` may be null. `muted`: identifiers of layers that are left out.
    Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                const std::vector<std::string>& muted, Payloads payloads);
    Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                const std::vector<std::string>& muted, Scope scope);
    Composition(const Composition&) = delete;
    Composition& operator=(const Composition&) = delete;

    /// Called by the owner for each SdfNotice::LayersDidChange of its thread.
    void follow(const pxr::SdfLayerChangeListVec& changes);
    /// Leaves out these layers and no others.
    void setMuted(const std::vector<std::string>& muted);
    /// Does the same, and adds what changes to `changes`, which the caller applies.
    void setMuted(const std::vector<std::string>& muted, pxr::PcpChanges& changes);
    /// Called by an owner that works out changes of the cache itself, instead of follow().
    void apply(const pxr::PcpChanges& changes);
    /// Composes the prims at `roots` and below, as far as the scope goes, on all cores.
    void composeInParallel(const pxr::SdfPathVector& roots);
    /// For what reads or plans over all that is composed.
    [[nodiscard]] pxr::PcpCache& cache() { return *cache_; }
    [[nodiscard]] const pxr::PcpCache& cache() const { return *cache_; }

    [[nodiscard]] const pxr::PcpLayerStack& localLayers() const;
    /// Another number whenever the local layers, or their offsets, have changed.
    [[nodiscard]] std::uint64_t localRevision() const { return localRevision_; }

    /// Composed when it is first asked for. Null: `prim` is no path of a prim. Valid until the
    /// layers change.
    [[nodiscard]] const pxr::PcpPrimIndex* primIndex(const pxr::SdfPath& prim);
    /// Names as composed, in order; of a prim that is not there, none.
    [[nodiscard]] pxr::TfTokenVector childNames(const pxr::SdfPath& prim);
    [[nodiscard]] pxr::TfTokenVector propertyNames(const pxr::SdfPath& prim);
    /// All layers that contribute. Composes all prims that are not composed yet.
    [[nodiscard]] pxr::SdfLayerHandleSet usedLayers();

    /// The number of prims composed until now, each as often as it was, for measurements and tests.
    [[nodiscard]] std::size_t primsComposed() const { return primsComposed_; }

private:
    const pxr::PcpPrimIndex* compose(const pxr::SdfPath& prim);
    void composeAll();

    std::unique_ptr<pxr::PcpCache> cache_;
    std::vector<std::string> muted_;
    const Scope scope_;
    bool complete_ = false;  // all prims are composed
    std::uint64_t localRevision_ = 1;
    std::size_t primsComposed_ = 0;
};

}  // namespace usdlive::stage
