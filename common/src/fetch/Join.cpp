// Exchanges an invitation for a token.
#include "usdlive/common/fetch/Join.h"

#include <nlohmann/json.hpp>

#include "usdlive/common/fetch/Http.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::fetch {

namespace {

using Json = nlohmann::json;

constexpr unsigned kSuccess = 200, kNotThere = 404, kSignIn = 401;

std::string firstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

/// Returns the reason in an answer of a usdlive server, or that it is none.
Error refusalIn(const HttpAnswer& answer, const Origin& origin) {
    const bool isOurs = answer.header("server") == "usdlive" && !answer.body.empty();
    if (isOurs && answer.status == kSignIn)
        return {ErrorCode::SignInRequired,
                "cannot join " + origin.url() + ": " + firstLine(answer.body)};
    return {ErrorCode::NotConnected,
            "cannot join " + origin.url() + ": " +
                (isOurs                       ? firstLine(answer.body)
                 : answer.status == kNotThere ? "this is no usdlive server, or an older one"
                                              : "HTTP " + std::to_string(answer.status))};
}

}  // namespace

Result<JoinedServer> join(const Invitation& invitation) {
    const KnownServers known;
    const auto before = known.find(invitation.host, invitation.port);
    if (!before) return tl::unexpected(before.error());
    // The pin has to be known before the code is sent. What was known stays known if that fails.
    KnownServer server = before->value_or(KnownServer());
    server.isTls = server.isTls || invitation.isTls;
    if (!invitation.pin.empty()) server.pin = invitation.pin;
    if (auto kept = known.keep(invitation.host, invitation.port, server); !kept)
        return tl::unexpected(kept.error());
    const auto restored = [&](Error error) {
        if (*before)
            (void)known.keep(invitation.host, invitation.port, **before);
        else
            (void)known.forget(invitation.host, invitation.port);
        return tl::unexpected(std::move(error));
    };
    const Origin origin{invitation.host, invitation.port, server.isTls};
    const auto answer = get({.origin = origin,
                             .target = "/join",
                             .headers = {{"Authorization", "Invitation " + invitation.code}},
                             .trust = Trust::Known,
                             .isPost = true},
                            {});
    if (!answer)
        return restored({ErrorCode::NotConnected,
                         "cannot reach " + origin.url() + ": " + answer.error().cause});
    if (answer->status != kSuccess) return restored(refusalIn(*answer, origin));
    const Json json = Json::parse(answer->body, nullptr, false);
    const auto text = [&](const char* name) {
        const auto found = json.is_object() ? json.find(name) : json.end();
        return json.is_object() && found != json.end() && found->is_string()
                   ? found->get<std::string>()
                   : std::string();
    };
    const std::string user = text("user"), token = text("token");
    if (user.empty() || token.empty())
        return restored(
            {ErrorCode::NotConnected, "cannot join " + origin.url() + ": the answer has no token"});
    auto kept = known.update(invitation.host, invitation.port, [&](KnownServer& entry) {
        entry.user = user;
        entry.token = token;
        entry.renewal.reset();  // it was that of another token
    });
    if (!kept) return tl::unexpected(kept.error());
    return JoinedServer{user, (server.isTls ? "wss://" : "ws://") + origin.hostInUrl() + ":" +
                                  std::to_string(origin.port)};
}

}  // namespace usdlive::fetch
