// Asks a running server for a copy of its store, and answers.
#include "usdlive/server/app/StoreCopyFile.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "usdlive/common/core/StoreId.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

constexpr std::size_t kNameDigits = 32;

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

/// Others see the whole file or none.
bool replaceWhole(const std::filesystem::path& path, const Json& json) {
    const std::filesystem::path draft = path.string() + ".new";
    {
        std::ofstream file(draft, std::ios::binary | std::ios::trunc);
        file << json.dump(-1, ' ', false, Json::error_handler_t::replace) << "\n";
        file.close();
        if (!file) return false;
    }
    std::error_code error;
    std::filesystem::rename(draft, path, error);
    return !error;
}

}  // namespace

Result<std::string> StoreCopyFile::ask() const {
    const std::string name = randomIdDigits();
    if (replaceWhole(path_, {{"copy", name}})) return name;
    return fail(ErrorCode::StorageFailed, "cannot write " + path_.string());
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
    (void)replaceWhole(answerPath(), json);
}

void StoreCopyFile::removeCopies() const {
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder_, error))
        if (const std::string name = entry.path().filename().string();
            name.starts_with(kCopies) && entry.is_directory(error))
            std::filesystem::remove_all(entry.path(), error);
}

}  // namespace usdlive::server
