// Runs the device flow of OAuth 2.0, and renews tokens.
#include "usdlive/common/fetch/IssuerSignIn.h"

#include <algorithm>
#include <ctime>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <utility>

#include "usdlive/common/core/Base64Url.h"
#include "usdlive/common/fetch/Issuer.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::fetch {

namespace {

using Json = nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;
using IsStopped = std::function<bool()>;

constexpr unsigned kGood = 200, kNone = 404;
constexpr const char* kDeviceGrant = "urn:ietf:params:oauth:grant-type:device_code";
// A token that ends within this time is renewed before it is sent.
constexpr std::int64_t kRenewBefore = 30;
constexpr milliseconds kRenewalWait{6'000};
// RFC 8628: the pause between two questions without another one, and what `slow_down` adds.
constexpr seconds kUsualPause{5}, kSlowDown{5}, kLongestPause{60}, kLongestAnswerTime{3'600};
constexpr milliseconds kLookForStop{100};
constexpr std::size_t kMostShownBytes = 200;

tl::unexpected<Error> refused(const std::string& why) {
    return fail(ErrorCode::SignInRequired, why);
}
tl::unexpected<Error> unreachableError(const std::string& why) {
    return fail(ErrorCode::NotConnected, why);
}

/// Returns a text of a stranger for a terminal: without control characters, and not too long.
std::string shown(std::string text) {
    text.resize(std::min(text.size(), kMostShownBytes));
    for (char& character : text)
        if (character < ' ' || character > '~') character = '?';
    return text;
}

std::string textOf(const Json& object, const char* name) {
    if (!object.is_object()) return {};
    const auto found = object.find(name);
    return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

seconds secondsOf(const Json& object, const char* name, seconds usual, seconds most) {
    const auto found = object.find(name);
    if (found == object.end() || !found->is_number()) return usual;
    return seconds(std::int64_t(std::clamp(found->get<double>(), 1.0, double(most.count()))));
}

/// Returns whether the time has passed without a stop.
bool rested(steady_clock::duration time, const IsStopped& isStopped) {
    for (const auto end = steady_clock::now() + time;;) {
        if (isStopped && isStopped()) return false;
        const auto left = end - steady_clock::now();
        if (left <= left.zero()) return true;
        std::this_thread::sleep_for(std::min<steady_clock::duration>(left, kLookForStop));
    }
}

/// An answer of the issuer to a form.
struct Answer {
    bool isGood = false;
    Json json;
    std::string error;  ///< the code of OAuth: access_denied ...

    [[nodiscard]] std::string problem() const {
        const std::string text = textOf(json, "error_description");
        return shown(error.empty() ? "an answer without a reason" : error) +
               (text.empty() ? "" : " (" + shown(text) + ")");
    }
};

Fetched<Answer> post(const ServiceUrl& url, const HttpHeaders& fields, const IsStopped& isStopped) {
    const auto answer = get({.origin = url.origin,
                             .target = url.target,
                             .headers = {{"Accept", "application/json"}},
                             .isPost = true,
                             .form = formOf(fields)},
                            issuerLimits(), isStopped);
    if (!answer) return tl::unexpected(answer.error());
    Answer parsed{answer->status == kGood, Json::parse(answer->body, nullptr, false), {}};
    parsed.error = textOf(parsed.json, "error");
    if (!parsed.json.is_object() || (!parsed.isGood && parsed.error.empty()))
        return failed("it answered HTTP " + std::to_string(answer->status), answer->status);
    return parsed;
}

/// Returns the end of a token by its own words. The server checks the token; here it only decides
/// when to ask for the next one.
std::int64_t endOf(const std::string& token) {
    const auto first = token.find('.'), second = token.find('.', first + 1);
    if (first == std::string::npos || second == std::string::npos) return 0;
    const auto bytes =
        base64UrlDecoded(std::string_view(token).substr(first + 1, second - first - 1));
    const Json claims = bytes ? Json::parse(*bytes, nullptr, false) : Json();
    const auto end = claims.is_object() ? claims.find("exp") : claims.end();
    return claims.is_object() && end != claims.end() && end->is_number_integer()
               ? end->get<std::int64_t>()
               : 0;
}

// ---- signing in

/// The way in that a server names.
struct Entrance {
    std::string issuer, clientId, scopes;
};

class Login {
public:
    Login(Origin server, bool isFirstUse, const IsStopped& isStopped)
        : server_(std::move(server)),
          trust_(isFirstUse ? Trust::FirstUse : Trust::Known),
          isStopped_(isStopped) {}

    Result<JoinedServer> run(const std::function<void(const DevicePrompt&)>& show) {
        auto entrance = ask();
        if (!entrance) return tl::unexpected(entrance.error());
        entrance_ = std::move(*entrance);
        auto issuer = discover(entrance_.issuer, isStopped_);
        if (!issuer) return unreachableError(ofIssuer(issuer.error().cause));
        if (!issuer->devices)
            return refused(
                ofIssuer("it offers no sign-in with another device; enable the device "
                         "flow (RFC 8628) for " +
                         shown(entrance_.clientId)));
        return signIn(*issuer, show).and_then([&](const Json& tokens) {
            return finish(*issuer, tokens);
        });
    }

private:
    [[nodiscard]] std::string ofIssuer(const std::string& why) const {
        return "cannot sign in with " + shown(entrance_.issuer) + ": " + why;
    }
    [[nodiscard]] std::string atServer(const std::string& why) const {
        return "cannot sign in at " + server_.url() + ": " + why;
    }
    [[nodiscard]] Fetched<HttpAnswer> getSignIn(HttpHeaders headers) const {
        return get({.origin = server_,
                    .target = "/sign-in",
                    .headers = std::move(headers),
                    .trust = trust_},
                   issuerLimits(), isStopped_);
    }
    /// Returns the reason that a server of usdlive gives.
    [[nodiscard]] static std::string reasonIn(const HttpAnswer& answer) {
        if (answer.header("server") != "usdlive" || answer.body.empty())
            return "HTTP " + std::to_string(answer.status) + "; is it a usdlive server?";
        return shown(answer.body.substr(0, answer.body.find('\n')));
    }

    [[nodiscard]] Result<Entrance> ask() const {
        const auto answer = getSignIn({});
        if (!answer) return unreachableError(atServer(answer.error().cause));
        if (answer->status == kNone && answer->header("server") == "usdlive")
            return refused(
                atServer("it has no issuer. Ask for an invitation and run `usdlive join "
                         "INVITATION`"));
        if (answer->status != kGood) return unreachableError(atServer(reasonIn(*answer)));
        const Json json = Json::parse(answer->body, nullptr, false);
        Entrance entrance{textOf(json, "issuer"), textOf(json, "clientId"), textOf(json, "scopes")};
        if (entrance.issuer.empty() || entrance.clientId.empty())
            return unreachableError(atServer("its answer names no issuer"));
        return entrance;
    }

    /// Leaves out `offline_access` if the issuer does not know it. It is asked for because some
    /// issuers give no refresh token without it.
    [[nodiscard]] std::string scopesFor(const Issuer& issuer) const {
        std::istringstream wanted(entrance_.scopes);
        std::string scopes;
        for (std::string scope; wanted >> scope;) {
            if (scope == "offline_access" && !issuer.scopes.empty() &&
                std::ranges::find(issuer.scopes, scope) == issuer.scopes.end())
                continue;
            scopes += (scopes.empty() ? "" : " ") + scope;
        }
        return scopes;
    }

    [[nodiscard]] Result<Json> signIn(const Issuer& issuer,
                                      const std::function<void(const DevicePrompt&)>& show) const {
        const auto begun =
            post(*issuer.devices, {{"client_id", entrance_.clientId}, {"scope", scopesFor(issuer)}},
                 isStopped_);
        if (!begun) return unreachableError(ofIssuer(begun.error().cause));
        if (!begun->isGood) return refused(ofIssuer("it answered " + begun->problem()));
        const std::string device = textOf(begun->json, "device_code");
        DevicePrompt prompt{shown(entrance_.issuer), textOf(begun->json, "verification_uri"),
                            textOf(begun->json, "verification_uri_complete"),
                            shown(textOf(begun->json, "user_code")),
                            secondsOf(begun->json, "expires_in", seconds(600), kLongestAnswerTime)};
        // People are sent there, so it has to be a place that can be trusted as much as the issuer.
        if (!parseServiceUrl(prompt.address) || device.empty() || prompt.code.empty())
            return refused(ofIssuer("its answer has no address and code for the user"));
        if (!parseServiceUrl(prompt.completeAddress)) prompt.completeAddress.clear();
        show(prompt);
        return poll(issuer, device, secondsOf(begun->json, "interval", kUsualPause, kLongestPause),
                    steady_clock::now() + prompt.time);
    }

    [[nodiscard]] Result<Json> poll(const Issuer& issuer, const std::string& device, seconds pause,
                                    steady_clock::time_point end) const {
        while (steady_clock::now() < end) {
            if (!rested(pause, isStopped_)) return refused(ofIssuer("it was interrupted"));
            const auto answer = post(issuer.tokens,
                                     {{"grant_type", kDeviceGrant},
                                      {"device_code", device},
                                      {"client_id", entrance_.clientId}},
                                     isStopped_);
            if (!answer) {  // RFC 8628: ask less often
                if (!answer.error().isUnreachable && answer.error().status < 500)
                    return unreachableError(ofIssuer(answer.error().cause));
                pause = std::min(2 * pause, kLongestPause);
                continue;
            }
            if (answer->isGood) return answer->json;
            if (answer->error == "slow_down")
                pause = std::min(pause + kSlowDown, kLongestPause);
            else if (answer->error == "access_denied")
                return refused(ofIssuer("the sign-in was refused there"));
            else if (answer->error == "expired_token")
                break;
            else if (answer->error != "authorization_pending")
                return refused(ofIssuer("it answered " + answer->problem()));
        }
        return refused(ofIssuer("nobody has answered in time. Run the command again"));
    }

    [[nodiscard]] Result<JoinedServer> finish(const Issuer& issuer, const Json& tokens) const {
        const std::string token = textOf(tokens, "id_token");
        const std::int64_t end = endOf(token);
        if (end == 0)
            return refused(
                ofIssuer("it gave no ID token; the scopes of the server "
                         "(--oidc-scopes) have to contain openid"));
        const auto answer = getSignIn({{"Authorization", "Bearer " + token}});
        if (!answer) return unreachableError(atServer(answer.error().cause));
        if (answer->status != kGood) return refused(atServer(reasonIn(*answer)));
        const std::string user = textOf(Json::parse(answer->body, nullptr, false), "user");
        if (user.empty()) return unreachableError(atServer("its answer names no user"));
        auto kept = KnownServers().update(server_.host, server_.port, [&](KnownServer& entry) {
            entry.user = user;
            entry.token = token;
            entry.isTls = entry.isTls || server_.isSecure;
            entry.renewal = TokenRenewal{issuer.tokensUrl, entrance_.clientId,
                                         textOf(tokens, "refresh_token"), end};
        });
        if (!kept) return tl::unexpected(kept.error());
        return JoinedServer{user, (server_.isSecure ? "wss://" : "ws://") + server_.hostInUrl() +
                                      ":" + std::to_string(server_.port)};
    }

    const Origin server_;
    const Trust trust_;
    const IsStopped& isStopped_;
    Entrance entrance_;
};

// ---- renewing

/// Asks for a new token. The failure has a status if the issuer has refused for good.
Fetched<KnownServer> renewed(const KnownServer& server, const IsStopped& isStopped) {
    const TokenRenewal& renewal = *server.renewal;
    if (renewal.refreshToken.empty()) return failed("the issuer gave no means to renew it");
    const auto url = parseServiceUrl(renewal.tokensUrl);
    if (!url) return failed("the address of the issuer cannot be used: " + url.error().cause);
    const auto answer = post(*url,
                             {{"grant_type", "refresh_token"},
                              {"refresh_token", renewal.refreshToken},
                              {"client_id", renewal.clientId}},
                             isStopped);
    if (!answer) return tl::unexpected(answer.error());
    if (!answer->isGood)
        return failed("the issuer answered " + answer->problem(),
                      answer->error == "invalid_grant" ? 400 : 0);
    KnownServer next = server;
    next.token = textOf(answer->json, "id_token");
    next.renewal->endsAt = endOf(next.token);
    if (const auto refresh = textOf(answer->json, "refresh_token"); !refresh.empty())
        next.renewal->refreshToken = refresh;
    if (next.renewal->endsAt == 0) return failed("the issuer gave no new ID token");
    return next;
}

bool isFresh(const KnownServer& server) {
    return !server.renewal || std::time(nullptr) + kRenewBefore < server.renewal->endsAt;
}

/// Renews the token of an entry, and returns the entry with it.
Result<KnownServer> renew(const KnownServers& known, const std::string& host, std::uint16_t port,
                          KnownServer server, const IsStopped& isStopped) {
    const auto lock = known.lockRenewal(kRenewalWait, isStopped);
    if (!lock) return tl::unexpected(lock.error());
    const auto again = known.find(host, port);  // another process may have renewed it
    if (!again) return tl::unexpected(again.error());
    if (*again) server = **again;
    if (isFresh(server)) return server;
    const auto next = *lock ? renewed(server, isStopped)
                            : Fetched<KnownServer>(failed("another program still renews it"));
    if (next) {
        auto kept = known.update(host, port, [&](KnownServer& entry) {
            entry.token = next->token;
            entry.renewal = next->renewal;
        });
        if (!kept) return tl::unexpected(kept.error());
        return *next;
    }
    if (next.error().status == 400)  // asking again would not help
        (void)known.update(host, port, [&](KnownServer& entry) {
            if (entry.renewal) entry.renewal->refreshToken.clear();
        });
    if (std::time(nullptr) < server.renewal->endsAt) return server;
    const std::string name = serverName(host, port);
    return refused("the sign-in at " + name + " has ended and could not be renewed: " +
                   next.error().cause + ". Run `usdlive login " + name + "`");
}

}  // namespace

Result<JoinedServer> login(const std::string& host, std::uint16_t port, bool isEncrypted,
                           const std::function<void(const DevicePrompt&)>& show,
                           const IsStopped& isStopped) {
    if (!isEncrypted && !isLoopback(host))
        return unreachableError("cannot sign in at " + serverName(host, port) +
                                ": the connection would not be encrypted, and others could read "
                                "the token. Use wss://" +
                                serverName(host, port) + ", and --tls at the server");
    return Login({host, port, isEncrypted}, isEncrypted, isStopped).run(show);
}

Result<std::optional<std::string>> authorizationFor(const std::string& host, std::uint16_t port,
                                                    bool isEncrypted, const IsStopped& isStopped) {
    const KnownServers known;
    const auto server = known.find(host, port);
    if (!server) return tl::unexpected(server.error());
    const bool isSent = *server && !(*server)->token.empty() && (isEncrypted || !(*server)->isTls);
    if (!isSent || isFresh(**server)) return known.authorization(host, port, isEncrypted);
    return renew(known, host, port, **server, isStopped).map([](const KnownServer& fresh) {
        return std::optional("Bearer " + fresh.token);
    });
}

}  // namespace usdlive::fetch
