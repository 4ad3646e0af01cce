// Reads the file of a project's access rules.
#include "auth/AccessRulesFile.h"

#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>

#include "auth/FileStamp.h"
#include "usdlive/common/core/OwnedFile.h"

namespace usdlive::server {

namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr mode_t kReadable = 0644;

/// Changes the list of rules while no other process does. The rest of the file stays as it is.
Result<AccessRules> changeRules(const AccessRulesFile& file,
                                const std::function<Result<void>(OrderedJson&)>& change) {
    std::error_code ignored;
    std::filesystem::create_directories(file.path().parent_path(), ignored);
    const auto lock = lockFile(file.path().string() + ".lock");
    if (!lock) return tl::unexpected(lock.error());
    const auto present = file.text();
    if (!present) return tl::unexpected(present.error());
    if (*present)
        if (const auto valid = file.parsed(**present); !valid) return tl::unexpected(valid.error());
    OrderedJson json = *present ? OrderedJson::parse(**present)
                                : OrderedJson{{"format", 1}, {"rules", OrderedJson::array()}};
    if (auto done = change(json["rules"]); !done) return tl::unexpected(done.error());
    const std::string text = json.dump(2) + "\n";
    auto rules = AccessRules::parse(text);
    if (!rules) return fail(ErrorCode::InvalidArgument, rules.error().message);
    if (auto written = replaceFile(file.path(), text, kReadable); !written)
        return tl::unexpected(written.error());
    return rules;
}

}  // namespace

Result<std::optional<std::string>> AccessRulesFile::text() const {
    std::error_code error;
    const auto status = std::filesystem::status(path_, error);
    if (status.type() == std::filesystem::file_type::not_found) return std::nullopt;
    const auto unusable = [this](const std::string& why) {
        return fail(ErrorCode::InvalidConfiguration, path_.string() + ": " + why);
    };
    if (status.type() != std::filesystem::file_type::regular)
        return unusable(error ? error.message() : "it is not a regular file");
    std::ifstream file(path_, std::ios::binary);
    std::string text{std::istreambuf_iterator<char>(file), {}};
    if (!file) return unusable("it cannot be read");
    return text;
}

Result<AccessRules> AccessRulesFile::parsed(std::string_view text) const {
    return AccessRules::parse(text).map_error([this](Error error) {
        error.message = path_.string() + ": " + error.message;
        return error;
    });
}

Result<std::optional<AccessRules>> AccessRulesFile::read() const {
    const auto found = text();
    if (!found) return tl::unexpected(found.error());
    if (!*found) return std::nullopt;
    return parsed(**found);
}

Result<AccessRules> AccessRulesFile::add(const AccessRule& rule) const {
    return changeRules(*this, [&](OrderedJson& rules) -> Result<void> {
        rules.push_back(OrderedJson::parse(textOf(rule)));
        return {};
    });
}

Result<AccessRules> AccessRulesFile::remove(std::size_t number) const {
    return changeRules(*this, [&](OrderedJson& rules) -> Result<void> {
        if (number == 0 || number > rules.size())
            return fail(ErrorCode::InvalidArgument, "there is no rule " + std::to_string(number) +
                                                        " in " + path_.string() + ", which has " +
                                                        std::to_string(rules.size()));
        rules.erase(number - 1);
        return {};
    });
}

void AccessRulesFile::writeTaken(const std::string& stamp) const {
    (void)replaceFile(takenPath(), stamp + "\n", kReadable);
}

std::optional<std::string> AccessRulesFile::taken() const {
    std::ifstream file(takenPath());
    std::string stamp;
    if (!std::getline(file, stamp)) return std::nullopt;
    return stamp;
}

std::optional<std::string> AccessRulesFile::stamp() const { return changeStampOf(path_); }

}  // namespace usdlive::server
