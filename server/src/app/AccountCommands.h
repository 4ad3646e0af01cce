// `usdlive user`: the commands that change the accounts, on the machine of the server.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace usdlive::server {

/// The name of this program when `usdlive user` starts it.
inline constexpr const char* kAccountCommands = "usdlive user";

/// Runs one command. Returns the exit code: 1 after an error of the file, 2 after one of the words.
[[nodiscard]] int runAccountCommand(int argc, const char* const* argv);

/// A running server writes this to `.usdlive/users.followed`.
struct FollowedAccounts {
    std::int64_t process = 0;
    std::uint64_t version = 0;  ///< that of the accounts that all its projects have
    std::string url;
    std::string pin;  ///< `sha256:HEX` of its own certificate; empty: an authority signed it
};
[[nodiscard]] std::filesystem::path followedAccountsFile(const std::filesystem::path& folder);
/// Writes the file atomically. Ignores a failure: `usdlive user` then says that the server has not
/// confirmed the change.
void write(const FollowedAccounts& followed, const std::filesystem::path& file);

}  // namespace usdlive::server
