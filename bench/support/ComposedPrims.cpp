// Keeps all prim indexes of a stage up to date, like a UsdStage.
#include "ComposedPrims.h"

#include <pxr/base/tf/weakPtr.h>
#include <pxr/usd/pcp/changes.h>
#include <pxr/usd/pcp/layerStackIdentifier.h>
#include <pxr/usd/pcp/primIndex.h>

#include <utility>

namespace usdlive::bench {

using pxr::SdfPath;

ComposedPrims::ComposedPrims(const pxr::SdfLayerHandle& root)
    : cache_(pxr::PcpLayerStackIdentifier(root), "usd", true) {
    compose(SdfPath::AbsoluteRootPath());
    key_ = pxr::TfNotice::Register(pxr::TfCreateWeakPtr(this), &ComposedPrims::onChanged);
}

ComposedPrims::~ComposedPrims() { pxr::TfNotice::Revoke(key_); }

std::size_t ComposedPrims::takeComposed() { return std::exchange(composed_, 0); }

void ComposedPrims::compose(const SdfPath& path) {
    pxr::PcpErrorVector errors;
    const auto& index = cache_.ComputePrimIndex(path, &errors);
    pxr::TfTokenVector names;
    pxr::PcpTokenSet prohibited;
    index.ComputePrimChildNames(&names, &prohibited);
    ++composed_;
    for (const auto& name : names) compose(path.AppendChild(name));
}

void ComposedPrims::onChanged(const pxr::SdfNotice::LayersDidChange& notice) {
    pxr::PcpChanges changes;
    changes.DidChange(&cache_, notice.GetChangeListVec());
    changes.Apply();
    for (const auto& [cache, change] : changes.GetCacheChanges()) {
        for (const SdfPath& path : change.didChangeSignificantly) compose(path);
        for (const SdfPath& path : change.didChangePrims) compose(path);
    }
}

}  // namespace usdlive::bench
