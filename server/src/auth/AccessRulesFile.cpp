// Reads the file of a project's access rules.
#include "usdlive/server/auth/AccessRulesFile.h"

#include <fstream>
#include <iterator>

#include "FileStamp.h"

namespace usdlive::server {

Result<std::optional<AccessRules>> AccessRulesFile::read() const {
    std::error_code error;
    const auto status = std::filesystem::status(path_, error);
    if (status.type() == std::filesystem::file_type::not_found) return std::nullopt;
    const auto unusable = [this](const std::string& why) {
        return fail(ErrorCode::InvalidConfiguration, path_.string() + ": " + why);
    };
    if (status.type() != std::filesystem::file_type::regular)
        return unusable(error ? error.message() : "it is not a regular file");
    std::ifstream file(path_, std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    if (!file) return unusable("it cannot be read");
    auto rules = AccessRules::parse(text);
    if (!rules) return unusable(rules.error().message);
    return std::move(*rules);
}

std::optional<std::string> AccessRulesFile::stamp() const { return changeStampOf(path_); }

}  // namespace usdlive::server
