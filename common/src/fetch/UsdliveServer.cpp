// Chooses the encryption, the token and the advice for a server of usdlive.
#include "usdlive/common/fetch/UsdliveServer.h"

#include <algorithm>
#include <cerrno>

#include "usdlive/common/fetch/IssuerSignIn.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::fetch {

namespace {

constexpr unsigned kUnauthorized = 401;

/// Adds what this user knows about the server.
Fetched<void> prepare(HttpRequest& request, const std::function<bool()>& isStopped) {
    Origin& origin = request.origin;
    const KnownServers known;
    const auto server = known.find(origin.host, origin.port);
    if (!server) return failed(server.error().message);
    request.trust = origin.isSecure ? Trust::FirstUse : Trust::Known;
    if (*server && (*server)->isTls) origin.isSecure = true;
    if (std::ranges::any_of(request.headers,
                            [](const auto& header) { return header.first == "Authorization"; }))
        return {};
    const auto authorization =
        authorizationFor(origin.host, origin.port, origin.isSecure, isStopped);
    if (!authorization) return failed(authorization.error().message);
    if (*authorization) request.headers.emplace_back("Authorization", **authorization);
    return {};
}

}  // namespace

Fetched<HttpAnswer> getFromServer(HttpRequest request, const HttpLimits& limits,
                                  std::function<bool()> isStopped) {
    if (auto prepared = prepare(request, isStopped); !prepared)
        return tl::unexpected(std::move(prepared.error()));
    auto answer = get(request, limits, std::move(isStopped));
    if (!answer && answer.error().error == ECONNREFUSED)
        answer.error().cause += ". Is `usdlive serve` running there?";
    if (answer && answer->status == kUnauthorized)
        return failed(
            "the server does not know this user. Sign in with `usdlive join INVITATION`, with an "
            "invitation from whoever runs it, or with `usdlive login HOST:PORT`",
            kUnauthorized);
    return answer;
}

}  // namespace usdlive::fetch
