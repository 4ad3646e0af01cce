// Parses JSON, and refuses what nlohmann-json would accept silently.
#include "auth/StrictJson.h"

#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace usdlive::server {

namespace {

constexpr int kDeepest = 16;

}  // namespace

tl::expected<nlohmann::json, JsonProblem> parseStrictly(std::string_view text) try {
    using Json = nlohmann::json;
    std::vector<std::set<std::string>> names;  // those in the objects that are open
    const auto watch = [&names](int depth, Json::parse_event_t event, Json& parsed) {
        if (depth >= kDeepest && (event == Json::parse_event_t::object_start ||
                                  event == Json::parse_event_t::array_start))
            throw JsonProblem::TooDeep;
        if (event == Json::parse_event_t::object_start) names.emplace_back();
        if (event == Json::parse_event_t::object_end) names.pop_back();
        if (event == Json::parse_event_t::key &&
            !names.back().insert(parsed.get<std::string>()).second)
            throw JsonProblem::MemberTwice;
        return true;
    };
    Json json = Json::parse(text, watch);
    if (!json.is_object()) return tl::unexpected(JsonProblem::NotAnObject);
    return json;
} catch (const JsonProblem& problem) {
    return tl::unexpected(problem);
} catch (const nlohmann::json::exception&) {
    return tl::unexpected(JsonProblem::NotJson);
}

}  // namespace usdlive::server
