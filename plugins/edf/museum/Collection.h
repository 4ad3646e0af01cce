// The answers of a museum's collection, from JSON.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

namespace usdlive::edf::museum {

struct Department {
    std::string id, displayName;
};

/// One object of the collection: its attributes as the schema names them (`title`,
/// `omni:met:artist:artistRole`).
struct MuseumObject {
    std::string id, name;
    std::vector<std::pair<const char*, std::string>> texts;
    std::vector<std::pair<const char*, bool>> flags;
    bool hasArtist = false;
};

/// The answer of /departments. Errors name what is wrong with the JSON.
[[nodiscard]] tl::expected<std::vector<Department>, std::string> readDepartments(
    std::string_view json);
/// The answer of /objects?departmentIds=ID: ids, in the order of the answer, each once.
[[nodiscard]] tl::expected<std::vector<std::string>, std::string> readObjectIds(
    std::string_view json);
/// The answer of /objects/ID. Missing texts are left out.
[[nodiscard]] tl::expected<MuseumObject, std::string> readObject(std::string_view json);

}  // namespace usdlive::edf::museum
