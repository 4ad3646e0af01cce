#pragma once

#include <pxr/usd/pcp/cache.h>
#include <pxr/usd/sdf/changeList.h>
#include <pxr/usd/sdf/layer.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace usdlive::stage {

/// What Pcp composes of a root layer and a session layer, kept up to date while their layers
/// change: an edit of a value composes nothing again, an edit of an arc only the prims that it
/// reaches.
///
/// One thread, the one that owns the layers. The layers are kept in memory as long as this lives.
class Composition {
public:
    /// `session` may be null. `muted`: identifiers of layers that are left out.
    Composition(const pxr::SdfLayerHandle& root, const pxr::SdfLayerHandle& session,
                const std::vector<std::string>& muted);
    Composition(const Composition&) = delete;
    Composition& operator=(const Composition&) = delete;

    /// Takes in what SdfNotice::LayersDidChange tells. True: the local layer stack is another one,
    /// in its layers or their offsets.
    bool follow(const pxr::SdfLayerChangeListVec& changes);

    [[nodiscard]] pxr::PcpCache& cache() { return *cache_; }
    /// Computed when it is not there. Null: `prim` is no path of a prim. Valid until follow().
    [[nodiscard]] const pxr::PcpPrimIndex* primIndex(const pxr::SdfPath& prim);
    /// Also what is above `prim` has its payloads from now on.
    void includePayloads(const pxr::SdfPath& prim);
    /// Names as composed, in order; of a prim that is not there, none.
    [[nodiscard]] pxr::TfTokenVector childNames(const pxr::SdfPath& prim);
    [[nodiscard]] pxr::TfTokenVector propertyNames(const pxr::SdfPath& prim);
    /// All layers that contribute, with all payloads included by now.
    [[nodiscard]] pxr::SdfLayerHandleSet usedLayers();

    /// How often primIndex() computed one, for measurements and tests.
    [[nodiscard]] std::size_t primsComposed() const { return primsComposed_; }

private:
    std::unique_ptr<pxr::PcpCache> cache_;
    std::size_t primsComposed_ = 0;
};

}  // namespace usdlive::stage
