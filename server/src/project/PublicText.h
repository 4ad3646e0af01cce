// Texts for clients name files relative to the project.
#pragma once

#include <string>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Removes folders of the machine from texts for clients (FR12). The texts of the log keep them.
class PublicText {
public:
    PublicText() = default;
    /// `folders` are absolute paths: the project's folder, as it is and as it was named.
    explicit PublicText(std::vector<std::string> folders);

    /// Returns "cannot open shot.usda" for "cannot open /home/ada/project/shot.usda", and "." for
    /// the folder itself.
    [[nodiscard]] std::string operator()(std::string text) const;
    [[nodiscard]] Error operator()(Error error) const;

private:
    std::vector<std::string> folders_;  ///< the longest first
};

}  // namespace usdlive::server
