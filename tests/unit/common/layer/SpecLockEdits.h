// The edit that locks a spec, as Kit's API writes it.
#pragma once

#include <string>

#include "usdlive/common/layer/Edit.h"

namespace usdlive {

/// Returns the edit of the root layer's pseudo-root that locks a spec for its owner.
[[nodiscard]] inline EditAction specLockEdit(const std::string& path, const UserName& owner) {
    return SetField{"customLayerData", DictionaryKey{{"omni_layer", "specs_locking", path}},
                    stringValue(owner.value), ValueType::None};
}

}  // namespace usdlive
