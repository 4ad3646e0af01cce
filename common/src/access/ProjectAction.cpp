// Tells the edits that lock or mute from other edits.
#include "usdlive/common/access/ProjectAction.h"

#include "usdlive/common/layer/GlobalMuteness.h"
#include "usdlive/common/layer/LayerLock.h"
#include "usdlive/common/layer/SpecLocks.h"

namespace usdlive {

std::optional<ProjectAction> projectActionOf(std::string_view path, const EditAction& action) {
    if (path != "/") return std::nullopt;
    if (isLockEdit(action) || isSpecLockEdit(action)) return ProjectAction::Lock;
    if (isMuteEdit(action)) return ProjectAction::Mute;
    return std::nullopt;
}

}  // namespace usdlive
