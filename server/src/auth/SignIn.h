// Decides who a request comes from.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "auth/Accounts.h"
#include "auth/OpenIdConnect.h"
#include "auth/OwnerToken.h"
#include "project/Subject.h"

namespace usdlive::server {

/// The reason why a request proves nobody.
struct Stranger {
    enum class Why {
        NoToken,
        UnknownToken,
        IssuedToken,  ///< `problem` says what is wrong with a token of the issuer
        NoKeys,       ///< the keys of the issuer are not known
        EndedToken,   ///< the token of the service account `user` has ended (AC12)
        IsService,    ///< the issuer signs somebody in under the name of a service account
        NoRole,       ///< `user` was proved, and has neither an account nor a role
    };
    Why why = Why::NoToken;
    std::optional<TokenProblem> problem = {};
    UserName user = {};
};

/// The issuer that signs users in (AC20).
struct IssuerSettings {
    IssuerRules rules;
    Role role = Role::None;  ///< for users without an account
    std::string clientId;    ///< the id of usdlive at the issuer
    std::string scopes;
    std::filesystem::path keysFile;  ///< empty: the issuer is asked for its keys
};

/// Knows the present accounts and tells who shows a token. Users have to sign in if the file of the
/// accounts exists when the server starts, or if there is an issuer. Belongs to one thread.
class SignIn {
public:
    /// `folder` contains `.usdlive/users.json`. `issuer`: nothing if there is none.
    explicit SignIn(const std::filesystem::path& folder,
                    std::optional<IssuerSettings> issuer = std::nullopt)
        : file_(folder), issuer_(std::move(issuer)) {}

    /// Reads the accounts. Error: InvalidConfiguration.
    [[nodiscard]] Result<void> start();
    /// Lets the owner of this process sign in on this machine, at this port.
    void letOwnerIn(std::uint16_t port);

    [[nodiscard]] bool isRequired() const { return accounts_ != nullptr; }
    [[nodiscard]] const AccountsFile& file() const { return file_; }
    [[nodiscard]] std::shared_ptr<const Accounts> accounts() const { return accounts_; }

    /// Replaces the accounts. Older ones are ignored; returns whether these were not.
    bool take(Accounts accounts);

    [[nodiscard]] const std::optional<IssuerSettings>& issuer() const { return issuer_; }
    /// Replaces the keys of the issuer. Without any, none of its tokens is accepted.
    void setIssuerKeys(std::optional<IssuerKeys> keys) { keys_ = std::move(keys); }

    /// Returns who shows this value of the header Authorization (AC1, AC20) at a time, in seconds
    /// since 1970.
    [[nodiscard]] tl::expected<SignedIn, Stranger> find(std::string_view authorization,
                                                        std::int64_t now) const;
    /// Returns the user with the role in a project.
    [[nodiscard]] static SignedIn in(const Accounts& accounts, SignedIn user,
                                     const std::string& project);

    /// The longest time that an answer waits. Below the time limits of clients, so that they can
    /// say why.
    static constexpr std::chrono::milliseconds kMostDelay{5'000};
    /// Returns for how long the answer to one more refused request of an address waits: from 100 ms
    /// to kMostDelay.
    [[nodiscard]] std::chrono::milliseconds refused(const std::string& address,
                                                    std::chrono::steady_clock::time_point now);
    [[nodiscard]] std::uint64_t refusals() const { return refusals_; }

private:
    [[nodiscard]] tl::expected<SignedIn, Stranger> findIssued(std::string_view token,
                                                              std::int64_t now) const;

    struct Failures {
        std::chrono::milliseconds delay{0};
        std::chrono::steady_clock::time_point last;
    };

    AccountsFile file_;
    const std::optional<IssuerSettings> issuer_;
    std::optional<IssuerKeys> keys_;
    std::optional<OwnerToken> owner_;
    std::shared_ptr<const Accounts> accounts_;
    std::map<std::string, Failures> failures_;  // by address
    std::uint64_t refusals_ = 0;
};

}  // namespace usdlive::server
