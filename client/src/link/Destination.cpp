// Finds where to connect, and the user's name there.
#include "link/Destination.h"

#include <utility>

#include "basics/SystemUser.h"
#include "usdlive/common/fetch/Join.h"
#include "usdlive/common/net/Invitation.h"
#include "usdlive/common/net/KnownServers.h"
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::client {

Result<UserName> nameAt(const ServerAddress& server, const std::string& given) {
    if (!given.empty()) return UserName{given};
    if (server.dds)
        return ddsSettings().map([](const auto& settings) {
            const std::string name = ddsIdentity(settings);
            return name.empty() ? systemUser() : UserName{name};
        });
    return KnownServers().find(server.host, server.port).map([](const auto& known) {
        return known && !known->user.empty() ? UserName{known->user} : systemUser();
    });
}

Result<Destination> destinationOf(const std::string& url, const std::string& user,
                                  const std::string& token) {
    std::string joined;
    if (isInvitation(url)) {
        const auto server = parseInvitation(url).and_then(fetch::join);
        if (!server) return tl::unexpected(server.error());
        joined = server->url;
    }
    auto address = parseServerAddress(joined.empty() ? url : joined);
    if (!address) return tl::unexpected(address.error());
    address->token = token;
    auto name = nameAt(*address, user);
    if (!name) return tl::unexpected(name.error());
    return Destination{std::move(*address), std::move(*name)};
}

Result<void> checkNames(const UserName& user, const std::string& application) {
    Hello hello;
    hello.user = user;
    hello.application = application;
    if (const auto sent = encodeChecked(hello); !sent)
        return fail(ErrorCode::InvalidArgument,
                    "the name of the user (at most 256 bytes) or of the application (at most 64 "
                    "KiB) cannot be sent: " +
                        sent.error().message);
    return {};
}

}  // namespace usdlive::client
