// Edits of a layer's root that lock the layer, or mute others for all users.
#include "session/RootEdits.h"

#include "session/OwnRights.h"
#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"

namespace usdlive::client {

Result<std::vector<EditAction>> lockEdits(const Session& session, const LayerId& layer, bool locked,
                                          std::int64_t nowMs) {
    const LayerDoc& doc = *session.view(layer);
    if (auto lockable = checkLockable(layer, doc); !lockable)
        return tl::unexpected(lockable.error());
    return lockEdits(doc, locked ? LayerLock{true, session.rights().user(), nowMs} : LayerLock{});
}

Result<std::vector<EditAction>> muteEdits(const Session& session, const LayerId& root,
                                          const LayerId& layer, bool muted) {
    if (root == layer)
        return fail(ErrorCode::InvalidArgument, "a root layer cannot be muted on its own stages");
    // The mute of a layer that left the project can be removed.
    if (!globallyMuted(session, root).contains(layer) && !session.projectLayers().contains(layer))
        return fail(ErrorCode::LayerNotFound, "the project has no layer " + layer.value);
    return globalMuteEdits(root, *session.view(root), layer, muted);
}

std::set<LayerId> globallyMuted(const Session& session, const LayerId& root) {
    const LayerDoc* doc = session.view(root);
    return doc ? usdlive::globallyMuted(root, *doc) : std::set<LayerId>();
}

}  // namespace usdlive::client
