// Follows a path of a layer into the past.
#include "usdlive/common/history/FormerPath.h"

#include <variant>

#include "usdlive/common/layer/SpecPath.h"

namespace usdlive {

bool FormerPath::isConcernedBy(const Edit& edit) const {
    if (edit.layer != layer_) return false;
    const std::string& at = edit.address.path;
    if (specpath::hasPrefix(at, path_)) return true;
    if (const auto* move = std::get_if<MoveSpec>(&edit.action))
        return specpath::hasPrefix(destination(at, *move), path_);
    return std::holds_alternative<DeleteSpec>(edit.action) && specpath::hasPrefix(path_, at);
}

void FormerPath::goBefore(const Edit& edit) {
    const auto* move = std::get_if<MoveSpec>(&edit.action);
    if (!move || edit.layer != layer_) return;
    const std::string to = destination(edit.address.path, *move);
    if (specpath::hasPrefix(path_, to))
        path_ = specpath::replacePrefix(path_, to, edit.address.path);
}

}  // namespace usdlive
