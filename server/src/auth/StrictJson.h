// Parses JSON from strangers.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>
#include <tl/expected.hpp>

namespace usdlive::server {

enum class JsonProblem { NotJson, MemberTwice, TooDeep, NotAnObject };

/// Parses an object. Each member may be there once only, because two programs that read the same
/// text would otherwise see different values. Objects and lists are at most 16 in each other.
[[nodiscard]] tl::expected<nlohmann::json, JsonProblem> parseStrictly(std::string_view text);

}  // namespace usdlive::server
