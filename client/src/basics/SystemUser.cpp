// Finds the name of the current user.
#include "basics/SystemUser.h"

#include <unistd.h>

#include <string>

#include "usdlive/common/core/AccountName.h"

namespace usdlive::client {

UserName systemUser() {
    return {accountName(geteuid()).value_or("user" + std::to_string(geteuid()))};
}

}  // namespace usdlive::client
