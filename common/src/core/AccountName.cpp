// Asks the system for the name of an account.
#include "usdlive/common/core/AccountName.h"

#include <pwd.h>

#include <vector>

namespace usdlive {

std::optional<std::string> accountName(uid_t account) {
    std::vector<char> memory(16'384);
    passwd entry{};
    passwd* found = nullptr;
    if (::getpwuid_r(account, &entry, memory.data(), memory.size(), &found) != 0 || !found ||
        !found->pw_name || !*found->pw_name)
        return std::nullopt;
    return found->pw_name;
}

}  // namespace usdlive
