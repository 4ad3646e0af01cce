// Asks a running server for a copy of its store, and answers.
#include "app/StoreCopyFile.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "usdlive/common/core/OwnedFile.h"
#include "usdlive/common/core/StoreId.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

constexpr std::size_t kNameDigits = 32;
// Server and command may run as different users.
constexpr mode_t kReadableByAll = 0644;

bool isCopyName(const std::string& name) {
    return name.size() == kNameDigits && std::ranges::all_of(name, [](char one) {
               return (one >= '0' && one <= '9') || (one >= 'a' && one <= 'f');
           });
}

std::optional<std::string> contentOf(const std::filesystem::path& path) {
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(path, ignored)) return std::nullopt;
    std::ifstream file(path, std::ios::binary);
    std::string text(std::istreambuf_iterator<char>(file), {});
    return file.bad() ? std::nullopt : std::optional(text);
}

Json parsed(const std::optional<std::string>& text) {
    return text ? Json::parse(*text, nullptr, false) : Json();
}

std::string textOf(const Json& json, const char* member) {
    const auto found = json.is_object() ? json.find(member) : json.end();
    return found != json.end() && found->is_string() ? found->get<std::string>() : std::string();
}

std::string lineOf(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace

Result<std::string> StoreCopyFile::ask() const {
    const std::string name = randomIdDigits();
    return replaceFile(path_, lineOf({{"copy", name}}), kReadableByAll).map([&] { return name; });
}

std::optional<Result<void>> StoreCopyFile::answer(const std::string& name) const {
    const Json json = parsed(contentOf(answerPath()));
    if (textOf(json, "copy") != name) return std::nullopt;
    const std::string error = textOf(json, "error");
    if (error.empty()) return Result<void>();
    return Result<void>(fail(ErrorCode::StorageFailed, error));
}

std::optional<std::string> StoreCopyFile::stamp() const { return contentOf(path_); }

std::optional<std::string> StoreCopyFile::read() const {
    const std::string name = textOf(parsed(contentOf(path_)), "copy");
    return isCopyName(name) ? std::optional(name) : std::nullopt;
}

void StoreCopyFile::writeAnswer(const std::string& name, const Result<void>& made) const {
    Json json{{"copy", name}};
    if (!made) json["error"] = made.error().message;
    (void)replaceFile(answerPath(), lineOf(json), kReadableByAll);
}

void StoreCopyFile::removeCopies() const {
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder_, error))
        if (const std::string name = entry.path().filename().string();
            name.starts_with(kCopies) && entry.is_directory(error))
            std::filesystem::remove_all(entry.path(), error);
}

}  // namespace usdlive::server
