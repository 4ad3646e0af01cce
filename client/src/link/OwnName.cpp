// Finds the name under which a user acts at a server.
#include "link/OwnName.h"

#include "basics/SystemUser.h"
#include "usdlive/common/net/KnownServers.h"

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

}  // namespace usdlive::client
