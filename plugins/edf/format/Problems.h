// Errors that OpenUSD posted, as one text.
#pragma once

#include <pxr/base/tf/errorMark.h>

#include <string>

namespace usdlive::edf {

/// Returns the texts of all errors since the mark, and removes them.
inline std::string takeProblems(pxr::TfErrorMark& mark) {
    std::string text;
    for (const auto& error : mark) text += (text.empty() ? "" : "; ") + error.GetCommentary();
    mark.Clear();
    return text.empty() ? "unknown reason" : text;
}

}  // namespace usdlive::edf
