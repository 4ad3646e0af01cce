// The file of a project's access rules.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "usdlive/common/access/AccessRules.h"

namespace usdlive::server {

/// The file `.usdlive/access.json` of a project. Any thread; blocks for the disk.
class AccessRulesFile {
public:
    explicit AccessRulesFile(const std::filesystem::path& folder)
        : path_(folder / ".usdlive" / "access.json") {}

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Returns nothing if there is no file. Error: InvalidConfiguration names the file and the line
    /// or the rule.
    [[nodiscard]] Result<std::optional<AccessRules>> read() const;
    /// Returns a value that differs when the file was changed; nothing if it cannot be found.
    [[nodiscard]] std::optional<std::string> stamp() const;

private:
    std::filesystem::path path_;
};

}  // namespace usdlive::server
