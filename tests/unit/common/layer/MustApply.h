// Applies edits that must succeed.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "usdlive/common/layer/LayerDoc.h"

namespace usdlive {

inline LayerDoc::Applied mustApply(LayerDoc& doc, const std::string& path,
                                   const EditAction& action) {
    const auto applied = doc.apply(path, action);
    EXPECT_TRUE(applied) << path << ": " << applied.error().message;
    return applied.value_or(LayerDoc::Applied{});
}

/// Applies the edits to the layer itself.
inline void mustApply(LayerDoc& doc, const std::vector<EditAction>& actions) {
    for (const EditAction& action : actions) mustApply(doc, "/", action);
}

}  // namespace usdlive
