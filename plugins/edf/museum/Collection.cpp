// Reads the JSON answers of a museum's service.
#include "Collection.h"

#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <unordered_set>

namespace usdlive::edf::museum {

namespace {

using nlohmann::json;

constexpr std::size_t kMaxTextBytes = 64 * 1024, kMaxDepartments = 1'000, kMaxIds = 1'000'000;
constexpr std::string_view kArtistPrefix = "omni:met:artist:";

// A name in the JSON, and the attribute that it becomes.
struct Field {
    const char* json;
    const char* attribute;
};

constexpr std::array kFlags = {Field{"isHighlight", "isHighlight"},
                               Field{"isPublicDomain", "isPublicDomain"}};
constexpr std::array kTexts = {
    Field{"accessionNumber", "accessionNumber"},
    Field{"accessionYear", "accessionYear"},
    Field{"primaryImage", "primaryImage"},
    Field{"primaryImageSmall", "primaryImageSmall"},
    Field{"department", "department"},
    Field{"title", "title"},
    Field{"culture", "culture"},
    Field{"period", "period"},
    Field{"dynasty", "dynasty"},
    Field{"reign", "reign"},
    Field{"portfolio", "portfolio"},
    Field{"artistRole", "omni:met:artist:artistRole"},
    Field{"artistPrefix", "omni:met:artist:artistPrefix"},
    Field{"artistDisplayName", "omni:met:artist:artistDisplayName"},
    Field{"artistDisplayBio", "omni:met:artist:artistDisplayBio"},
    Field{"artistSuffix", "omni:met:artist:artistSuffix"},
    Field{"artistAlphaSort", "omni:met:artist:artistAlphaSort"},
    Field{"artistNationality", "omni:met:artist:artistNationality"},
    Field{"artistGender", "omni:met:artist:artistGender"},
    Field{"artistWikidata_URL", "omni:met:artist:artistWikidata_URL"},
    Field{"artistULAN_URL", "omni:met:artist:artistULAN_URL"},
};

template <class Made>
using Read = tl::expected<Made, std::string>;

tl::unexpected<std::string> wrong(const std::string& what) {
    return tl::unexpected("malformed answer: " + what);
}

Read<json> parsed(std::string_view text) {
    json value = json::parse(text, nullptr, /*allow_exceptions=*/false);
    if (value.is_discarded()) return wrong("it is no JSON");
    if (!value.is_object()) return wrong("it is no JSON object");
    return value;
}

// Layers are also written as text, which has no place for control characters.
std::string printable(std::string text) {
    for (char& c : text)
        if ((static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t') || c == 0x7f) c = ' ';
    return text;
}

// A text or a number as text, null as an empty text; nothing for other values.
std::optional<std::string> textOf(const json& value) {
    if (value.is_null()) return std::string();
    if (value.is_number_integer()) return value.dump();
    if (!value.is_string() || value.get_ref<const std::string&>().size() > kMaxTextBytes)
        return std::nullopt;
    return printable(value.get<std::string>());
}

// The number of a department or an object as text. They become parts of URLs, so nothing else will
// do.
std::optional<std::string> idOf(const json& object, const char* key) {
    const auto found = object.find(key);
    if (found == object.end()) return std::nullopt;
    if (found->is_number_unsigned()) return std::to_string(found->get<std::uint64_t>());
    if (!found->is_string()) return std::nullopt;
    const auto& text = found->get_ref<const std::string&>();
    const bool isNumber = !text.empty() && text.size() <= 20 &&
                          text.find_first_not_of("0123456789") == std::string::npos;
    return isNumber ? std::optional(text) : std::nullopt;
}

}  // namespace

Read<std::vector<Department>> readDepartments(std::string_view text) {
    const auto value = parsed(text);
    if (!value) return tl::unexpected(value.error());
    const auto list = value->find("departments");
    if (list == value->end() || !list->is_array()) return wrong("there is no list 'departments'");
    if (list->size() > kMaxDepartments)
        return wrong("more than " + std::to_string(kMaxDepartments) + " departments");
    std::vector<Department> departments;
    std::unordered_set<std::string> seen;
    for (const json& one : *list) {
        const auto id = one.is_object() ? idOf(one, "departmentId") : std::nullopt;
        if (!id) return wrong("a department has no number 'departmentId'");
        const auto name = textOf(one.value("displayName", json()));
        if (!name) return wrong("'displayName' of the department " + *id + " is no text");
        if (seen.insert(*id).second) departments.push_back({*id, *name});
    }
    return departments;
}

Read<std::vector<std::string>> readObjectIds(std::string_view text) {
    const auto value = parsed(text);
    if (!value) return tl::unexpected(value.error());
    const auto list = value->find("objectIDs");
    // An empty department has null here.
    if (list != value->end() && list->is_null()) return std::vector<std::string>();
    if (list == value->end() || !list->is_array()) return wrong("there is no list 'objectIDs'");
    if (list->size() > kMaxIds) return wrong("more than " + std::to_string(kMaxIds) + " objects");
    std::vector<std::string> ids;
    std::unordered_set<std::uint64_t> seen;
    for (const json& one : *list) {
        if (!one.is_number_unsigned()) return wrong("an id in 'objectIDs' is no number");
        if (seen.insert(one.get<std::uint64_t>()).second)
            ids.push_back(std::to_string(one.get<std::uint64_t>()));
    }
    return ids;
}

Read<MuseumObject> readObject(std::string_view text) {
    const auto value = parsed(text);
    if (!value) return tl::unexpected(value.error());
    const auto id = idOf(*value, "objectID");
    if (!id) return wrong("there is no number 'objectID'");
    MuseumObject object;
    object.id = *id;
    const auto name = textOf(value->value("objectName", json()));
    if (!name) return wrong("'objectName' is no text");
    object.name = *name;
    for (const auto& [key, attribute] : kFlags) {
        const auto found = value->find(key);
        if (found == value->end() || found->is_null()) continue;
        if (!found->is_boolean()) return wrong("'" + std::string(key) + "' is no boolean");
        object.flags.emplace_back(attribute, found->get<bool>());
    }
    for (const auto& [key, attribute] : kTexts) {
        const auto found = value->find(key);
        if (found == value->end()) continue;
        auto field = textOf(*found);
        if (!field) return wrong("'" + std::string(key) + "' is no text of at most 64 KiB");
        if (field->empty()) continue;
        object.hasArtist |= std::string_view(attribute).starts_with(kArtistPrefix);
        object.texts.emplace_back(attribute, std::move(*field));
    }
    return object;
}

}  // namespace usdlive::edf::museum
