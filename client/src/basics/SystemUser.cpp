// Finds the name of the current user.
#include "basics/SystemUser.h"

#include <pwd.h>
#include <unistd.h>

namespace usdlive::client {

UserName systemUser() {
    const passwd* entry = getpwuid(geteuid());
    if (entry && entry->pw_name && *entry->pw_name) return {entry->pw_name};
    return {"user" + std::to_string(geteuid())};
}

}  // namespace usdlive::client
