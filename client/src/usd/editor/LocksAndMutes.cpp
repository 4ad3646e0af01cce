// Locks layers, and mutes them for all users, by edits of a layer's root.
#include "usd/editor/LocksAndMutes.h"

#include <pxr/base/vt/dictionary.h>
#include <pxr/usd/sdf/schema.h>

#include "basics/Clocks.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::client {

namespace {

bool holdsKitLocks(const pxr::SdfLayerRefPtr& layer) {
    return layer
        ->GetFieldDictValueByKey(pxr::SdfPath::AbsoluteRootPath(),
                                 pxr::SdfFieldKeys->CustomLayerData,
                                 pxr::TfToken("omni_layer:locked"))
        .IsHolding<pxr::VtDictionary>();
}

}  // namespace

Result<LiveLayer*> LocksAndMutes::filled(const LayerId& id) const {
    LiveLayer* live = layers_.find(id);
    if (!live || !live->isFilled())
        return fail(ErrorCode::LayerNotOpen, id.value + " is not open here");
    return live;
}

Result<void> LocksAndMutes::setLocked(const LayerId& id, bool locked,
                                      const std::function<void()>& alongside) {
    const auto live = filled(id);
    if (!live) return tl::unexpected(live.error());
    if (holdsKitLocks((*live)->layer()))
        return fail(ErrorCode::InvalidArgument,
                    id.value +
                        " is the root layer of a stage, in which Kit keeps what is locked: it "
                        "cannot be locked itself");
    LayerLock lock;
    if (locked) lock = {true, {user_.value}, wallClockMs()};
    frame_.author(
        layers_, session_, **live, [&] { return lockEdits(*session_.view(id), lock); }, alongside);
    return {};
}

Result<void> LocksAndMutes::setGloballyMuted(const LayerId& root, const LayerId& layer,
                                             bool muted) {
    const auto live = filled(root);
    if (!live) return tl::unexpected(live.error());
    if (root == layer)
        return fail(ErrorCode::InvalidArgument, "a root layer cannot be muted on its own stages");
    // The mute of a layer that left the project can be removed.
    if (!globallyMuted(root).contains(layer) && !session_.projectLayers().contains(layer))
        return fail(ErrorCode::LayerNotFound, "the project has no layer " + layer.value);
    frame_.author(layers_, session_, **live,
                  [&] { return globalMuteEdits(root, *session_.view(root), layer, muted); });
    return {};
}

std::set<LayerId> LocksAndMutes::globallyMuted(const LayerId& root) const {
    const LayerDoc* doc = session_.view(root);
    return doc ? usdlive::globallyMuted(root, *doc) : std::set<LayerId>();
}

}  // namespace usdlive::client
