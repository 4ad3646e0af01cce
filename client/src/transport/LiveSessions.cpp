// Asks a server about live sessions over HTTP.
#include "transport/LiveSessions.h"

#include <cctype>
#include <nlohmann/json.hpp>

#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/fetch/UsdliveServer.h"

namespace usdlive::client {

namespace {

using Json = nlohmann::json;

constexpr std::string_view kInAddress = "?session=";
constexpr unsigned kDone = 200, kUnknown = 404;
constexpr std::uint64_t kMostAnswerBytes = 4 * 1024 * 1024;

template <class Value>
Value valueIn(const Json& object, const char* name) {
    const auto found = object.find(name);
    if (found == object.end()) return {};
    try {
        return found->get<Value>();
    } catch (const Json::exception&) {
        return {};
    }
}

/// The name is one part of the path, whatever is in it.
std::string encodedName(const std::string& name) {
    return percentEncodedIf(name, [](char one) {
        return !std::isalnum(static_cast<unsigned char>(one)) &&
               std::string_view("-._~").find(one) == std::string_view::npos;
    });
}

ListedLiveSession listed(const Json& object) {
    ListedLiveSession one{valueIn<std::string>(object, "name"),
                          valueIn<std::string>(object, "creator"),
                          valueIn<std::int64_t>(object, "time"),
                          valueIn<Revision>(object, "revision"),
                          valueIn<Revision>(object, "begin"),
                          valueIn<bool>(object, "ended"),
                          valueIn<Revision>(object, "merged"),
                          valueIn<std::string>(object, "error"),
                          valueIn<std::vector<std::string>>(object, "users")};
    const auto merges = object.find("merges");
    if (merges == object.end() || !merges->is_array()) return one;
    for (const Json& merge : *merges)
        if (merge.is_object())
            one.merges.push_back({valueIn<std::string>(merge, "target") == "main",
                                  valueIn<Revision>(merge, "from"),
                                  valueIn<Revision>(merge, "into"),
                                  {valueIn<std::string>(merge, "client")},
                                  std::chrono::milliseconds(valueIn<std::int64_t>(merge, "age"))});
    return one;
}

std::string changePath(const std::string& name, std::string_view verb, const UserName& user) {
    return "/" + encodedName(name) + "/" + std::string(verb) + "?user=" + encodedName(user.value);
}

Result<Json> ask(const ServerAddress& server, const std::string& rest, bool isPost,
                 std::chrono::milliseconds timeout) {
    if (server.dds)
        return fail(
            ErrorCode::InvalidArgument,
            "live sessions are listed and changed over HTTP: use the address ws://HOST:PORT "
            "of the server");
    const ServerAddress main = mainLineAddress(server);
    const std::string path =
        (main.project.empty() ? "" : "/" + percentEncoded(main.project)) + "/sessions" + rest;
    fetch::HttpLimits limits{timeout, timeout, timeout, timeout};
    limits.bodyBytes = kMostAnswerBytes;
    fetch::HttpRequest request{
        .origin = {main.host, main.port, main.isSecure}, .target = path, .isPost = isPost};
    if (!main.token.empty()) request.headers.emplace_back("Authorization", "Bearer " + main.token);
    const auto answer = fetch::getFromServer(std::move(request), limits);
    if (!answer)
        return fail(ErrorCode::NotConnected,
                    "cannot reach " + main.url() + ": " + answer.error().cause);
    if (answer->status != kDone) {
        const bool isOurs = answer->header("server") == "usdlive" && !answer->body.empty();
        const std::string reason = answer->body.substr(0, answer->body.find('\n'));
        if (isOurs && reason != "there is nothing here")
            return fail(ErrorCode::InvalidArgument, reason);
        return fail(ErrorCode::InvalidArgument,
                    main.url() + (answer->status == kUnknown
                                      ? " has no live sessions: the server is an older one"
                                      : ": HTTP " + std::to_string(answer->status)));
    }
    Json body = Json::parse(answer->body, nullptr, false);
    if (body.is_object()) return body;
    return fail(ErrorCode::NotConnected, main.url() + " is no server of usdlive");
}

}  // namespace

ServerAddress liveSessionAddress(const ServerAddress& server, const std::string& name) {
    ServerAddress address = mainLineAddress(server);
    address.project += std::string(kInAddress) + name;
    return address;
}

ServerAddress mainLineAddress(const ServerAddress& server) {
    ServerAddress address = server;
    address.project.resize(std::min(address.project.find(kInAddress), address.project.size()));
    return address;
}

Result<std::vector<ListedLiveSession>> listLiveSessions(const ServerAddress& server,
                                                        std::chrono::milliseconds timeout) {
    const auto body = ask(server, "", false, timeout);
    if (!body) return tl::unexpected(body.error());
    std::vector<ListedLiveSession> all;
    if (const auto found = body->find("sessions"); found != body->end() && found->is_array())
        for (const Json& one : *found)
            if (one.is_object()) all.push_back(listed(one));
    return all;
}

Result<ListedLiveSession> changeLiveSession(const ServerAddress& server, const std::string& name,
                                            std::string_view verb, const UserName& user,
                                            std::chrono::milliseconds timeout,
                                            Revision mainRevision) {
    std::string rest = changePath(name, verb, user);
    if (mainRevision > 0)
        rest += (verb == "create" ? "&from=" : "&merged=") + std::to_string(mainRevision);
    const auto body = ask(server, rest, true, timeout);
    if (!body) return tl::unexpected(body.error());
    return listed(*body);
}

Result<void> noteMerge(const ServerAddress& server, const std::string& name, const UserName& user,
                       const NotedMerge& merge, std::size_t known,
                       std::chrono::milliseconds timeout) {
    const std::string rest =
        changePath(name, "note-merge", user) +
        "&target=" + (merge.isIntoMain ? "main" : "session") +
        "&from=" + std::to_string(merge.from) + "&into=" + std::to_string(merge.into) +
        "&client=" + encodedName(merge.client.value) + "&known=" + std::to_string(known);
    return ask(server, rest, true, timeout).map([](const Json&) {});
}

}  // namespace usdlive::client
