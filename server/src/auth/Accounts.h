// The users of a server: their roles, their tokens and their invitations.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Hash.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/core/Result.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive::server {

/// Returns 256 random bits as 64 hexadecimal digits: a token, or the code of an invitation.
[[nodiscard]] std::string newSecret();
[[nodiscard]] Hash hashOfSecret(std::string_view secret);

/// Returns an error if the text cannot be the name of a user: 1 to 64 letters, digits and ".-_@".
[[nodiscard]] Result<void> checkUserName(std::string_view name);

/// A personal token. The file has its hash only.
struct AccountToken {
    std::string id;  ///< the first 8 digits of the hash; for people and logs
    Hash hash;
    std::int64_t madeAt = 0;                  ///< seconds since 1970
    std::optional<std::int64_t> endsAt = {};  ///< nothing: it works until it is revoked
};

/// A code that is exchanged for a token once.
struct AccountInvitation {
    Hash hash;
    std::int64_t endsAt = 0;  ///< seconds since 1970
};

struct Account {
    Role role = Role::None;                ///< in each project that `projects` does not name
    std::map<std::string, Role> projects;  ///< by name
    std::vector<AccountToken> tokens;
    std::vector<AccountInvitation> invitations;
    /// True for a program (AC12): it gets tokens and no invitations.
    bool isService = false;
};

/// The accounts of a server, a value.
class Accounts {
public:
    static constexpr std::size_t kMostTokens = 100;  ///< the limit for one user
    static constexpr std::int64_t kInvitationSeconds = 24 * 60 * 60;

    /// Parses the content of the file. Error: InvalidConfiguration says what is wrong and where.
    [[nodiscard]] static Result<Accounts> parse(std::string_view text);
    [[nodiscard]] std::string text() const;

    [[nodiscard]] const std::map<UserName, Account>& users() const { return users_; }
    /// Increases with each change of the file.
    [[nodiscard]] std::uint64_t version() const { return version_; }

    struct Proved {
        UserName user;
        std::string token;  ///< the id
        std::optional<std::int64_t> endsAt = {};
    };
    /// Returns whose token it is, also if it has ended.
    [[nodiscard]] std::optional<Proved> find(std::string_view token) const;
    /// Returns the role of a user in a project; nothing if there is no such user.
    [[nodiscard]] std::optional<Role> roleOf(const UserName& user,
                                             const std::string& project) const;
    /// Returns the role of a user in a project; None if the user or the token was removed.
    [[nodiscard]] Role roleOf(const UserName& user, const std::string& token,
                              const std::string& project) const;

    // Errors of all changes: InvalidArgument names the user or the token.

    [[nodiscard]] Result<void> add(const UserName& user, Role role, bool isService = false);
    [[nodiscard]] Result<void> remove(const UserName& user);
    /// Sets the role in one project, or in all others if `project` is empty.
    [[nodiscard]] Result<void> setRole(const UserName& user, Role role, const std::string& project);
    /// Returns the code of a new invitation for the user.
    [[nodiscard]] Result<std::string> invite(const UserName& user, std::int64_t now);
    struct Joined {
        UserName user;
        std::string token;  ///< the token itself
    };
    /// Exchanges the code of an invitation for a token. The code is used up by that.
    [[nodiscard]] Result<Joined> join(std::string_view code, std::int64_t now);
    /// Returns a new token of a service account, with its end or without.
    [[nodiscard]] Result<std::string> makeToken(const UserName& user, std::int64_t now,
                                                std::optional<std::int64_t> endsAt);
    /// Removes the token with this id, and returns whose it was.
    [[nodiscard]] Result<UserName> revoke(std::string_view token);

private:
    friend class AccountsFile;

    [[nodiscard]] Result<Account*> named(const UserName& user);
    /// Adds a token, and returns it.
    [[nodiscard]] static Result<std::string> addToken(const UserName& user, Account& account,
                                                      std::int64_t now,
                                                      std::optional<std::int64_t> endsAt);

    std::uint64_t version_ = 0;
    std::map<UserName, Account> users_;
};

/// The file of the accounts, `.usdlive/users.json` in a folder. Nobody but its owner may read it.
/// Several processes may change it at the same time. Any thread; blocks for the disk.
class AccountsFile {
public:
    explicit AccountsFile(const std::filesystem::path& folder);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Returns nothing if there is no file: users are not asked to sign in.
    /// Errors: InvalidConfiguration names the file and says what to do.
    [[nodiscard]] Result<std::optional<Accounts>> read() const;
    /// Reads the accounts, or begins with none, changes them and replaces the file, if `change`
    /// returns no error. Returns the new accounts. Errors: those of read() and `change`, and
    /// StorageFailed.
    [[nodiscard]] Result<Accounts> change(
        const std::function<Result<void>(Accounts&)>& change) const;
    /// Returns a value that differs when the file was replaced; nothing if it cannot be found.
    [[nodiscard]] std::optional<std::string> stamp() const;

private:
    std::filesystem::path path_;
};

}  // namespace usdlive::server
