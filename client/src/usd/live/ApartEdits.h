// Edits that OpenUSD does not survive in one change block with others.
#pragma once

#include <deque>
#include <string_view>
#include <vector>

#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// The edits of a layer's `expressionVariables` and `subLayers`, which OpenUSD (26.8) needs in
/// change blocks of their own (decision 26).
class ApartEdits {
public:
    /// Keeps the edit and returns true, if it is one of those.
    bool take(std::string_view path, const EditAction& action);
    [[nodiscard]] bool isEmpty() const;
    /// Returns the edits of the next change block, all with the path "/". Precondition: not empty.
    [[nodiscard]] std::vector<EditAction> next();

private:
    std::vector<EditAction> variables_, subLayers_;
    std::deque<std::vector<EditAction>> steps_;  // in which variables_ are changed
};

}  // namespace usdlive::client
