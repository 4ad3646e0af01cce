// Follows a path of a layer into the past.
#pragma once

#include <string>
#include <utility>

#include "usdlive/common/layer/Edit.h"

namespace usdlive {

/// A spec of a layer, at the path that it had at an earlier moment. Pass it the edits of the
/// history, the newest first.
class FormerPath {
public:
    /// `path`: after the newest edit.
    FormerPath(LayerId layer, std::string path)
        : layer_(std::move(layer)), path_(std::move(path)) {}

    /// Returns whether the edit changes the spec, its place, or something below it.
    [[nodiscard]] bool isConcernedBy(const Edit& edit) const;
    /// Goes back to the moment before the edit.
    void goBefore(const Edit& edit);

    [[nodiscard]] const LayerId& layer() const { return layer_; }
    [[nodiscard]] const std::string& path() const { return path_; }

private:
    LayerId layer_;
    std::string path_;
};

}  // namespace usdlive
