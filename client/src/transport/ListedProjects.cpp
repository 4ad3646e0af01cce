// Requests the projects of a server over HTTP.
#include <nlohmann/json.hpp>

#include "transport/Connection.h"
#include "usdlive/common/fetch/UsdliveServer.h"

namespace usdlive::client {

namespace {

using Json = nlohmann::json;

constexpr unsigned kOk = 200, kNotFound = 404;
constexpr std::uint64_t kMostBytes = 16 * 1024 * 1024;

std::string textOf(const Json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

std::uint64_t numberOf(const Json& object, const char* name) {
    const auto found = object.find(name);
    return found != object.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : 0;
}

}  // namespace

Result<ListedProjects> listProjects(const ServerAddress& server,
                                    std::chrono::milliseconds timeout) {
    ServerAddress asked = server;
    asked.project.clear();
    asked.layer.clear();
    fetch::HttpLimits limits{timeout, timeout, timeout, timeout};
    limits.bodyBytes = kMostBytes;
    const auto answer =
        fetch::getFromServer({{asked.host, asked.port, asked.isSecure}, "/projects"}, limits);
    if (!answer)
        return fail(ErrorCode::NotConnected,
                    "cannot reach " + asked.url() + ": " + answer.error().cause);
    if (answer->status == kNotFound) return ListedProjects{};
    const Json body = Json::parse(answer->body, nullptr, false);
    if (answer->status != kOk || !body.is_object() || !body.contains("projects") ||
        !body["projects"].is_array())
        return fail(ErrorCode::Internal, asked.url() +
                                             " does not say which projects it has: HTTP " +
                                             std::to_string(answer->status));
    ListedProjects projects;
    projects.areSeveral = body.value("several", false);
    for (const Json& one : body["projects"])
        if (one.is_object())
            projects.all.push_back({textOf(one, "name"), textOf(one, "status"),
                                    textOf(one, "reason"), numberOf(one, "revision"),
                                    std::size_t(numberOf(one, "sessions"))});
    return projects;
}

ServerAddress findProject(ServerAddress address, std::chrono::milliseconds timeout) {
    const auto slash = address.layer.find('/');
    const bool hasProject = !address.project.empty() && !address.project.starts_with('?');
    if (address.dds || hasProject || slash == std::string::npos) return address;
    const auto projects = listProjects(address, timeout);
    if (!projects || !projects->areSeveral) return address;
    const std::string first = address.layer.substr(0, slash);
    for (const ListedProject& project : projects->all) {
        if (project.name != first) continue;
        address.project.insert(0, first);  // before that of a live session
        address.layer.erase(0, slash + 1);
        return address;
    }
    return address;
}

}  // namespace usdlive::client
