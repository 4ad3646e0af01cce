// The file of a project's access rules.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "usdlive/common/access/AccessRules.h"

namespace usdlive::server {

/// The file `.usdlive/access.json` of a project. Any thread; blocks for the disk.
class AccessRulesFile {
public:
    explicit AccessRulesFile(const std::filesystem::path& folder)
        : path_(folder / ".usdlive" / "access.json") {}

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Returns the content; nothing if there is no file. Error: InvalidConfiguration names the
    /// file.
    [[nodiscard]] Result<std::optional<std::string>> text() const;
    /// Error: InvalidConfiguration names the file and the line or the rule.
    [[nodiscard]] Result<AccessRules> parsed(std::string_view text) const;
    /// Returns nothing if there is no file. Errors: those of text() and parsed().
    [[nodiscard]] Result<std::optional<AccessRules>> read() const;
    /// Adds a rule at the end, or removes the rule with this number, from 1, and returns the new
    /// rules. Several processes may do so at the same time. Errors: those of read();
    /// InvalidArgument if there is no such rule, or this one cannot be; StorageFailed.
    [[nodiscard]] Result<AccessRules> add(const AccessRule& rule) const;
    [[nodiscard]] Result<AccessRules> remove(std::size_t number) const;
    /// Returns a value that differs when the file was changed; nothing if it cannot be found.
    [[nodiscard]] std::optional<std::string> stamp() const;

    /// A running server that has taken the rules keeps their stamp beside the file.
    void writeTaken(const std::string& stamp) const;
    [[nodiscard]] std::optional<std::string> taken() const;

private:
    [[nodiscard]] std::filesystem::path takenPath() const { return path_.string() + ".taken"; }

    std::filesystem::path path_;
};

}  // namespace usdlive::server
