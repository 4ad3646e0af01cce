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

#include "usdlive/server/auth/Accounts.h"
#include "usdlive/server/auth/OwnerToken.h"
#include "usdlive/server/project/Subject.h"

namespace usdlive::server {

/// Knows the present accounts and tells who shows a token. Users have to sign in if the file of the
/// accounts exists when the server starts. Belongs to one thread.
class SignIn {
public:
    /// `folder` contains `.usdlive/users.json`.
    explicit SignIn(const std::filesystem::path& folder) : file_(folder) {}

    /// Reads the accounts. Error: InvalidConfiguration.
    [[nodiscard]] Result<void> start();
    /// Lets the owner of this process sign in on this machine, at this port.
    void letOwnerIn(std::uint16_t port);

    [[nodiscard]] bool isRequired() const { return accounts_ != nullptr; }
    [[nodiscard]] const AccountsFile& file() const { return file_; }
    [[nodiscard]] std::shared_ptr<const Accounts> accounts() const { return accounts_; }

    /// Replaces the accounts. Older ones are ignored; returns whether these were not.
    bool take(Accounts accounts);

    /// Returns who shows this value of the header Authorization (AC1); nothing if it proves nobody.
    [[nodiscard]] std::optional<SignedIn> find(std::string_view authorization) const;
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
    struct Failures {
        std::chrono::milliseconds delay{0};
        std::chrono::steady_clock::time_point last;
    };

    AccountsFile file_;
    std::optional<OwnerToken> owner_;
    std::shared_ptr<const Accounts> accounts_;
    std::map<std::string, Failures> failures_;  // by address
    std::uint64_t refusals_ = 0;
};

}  // namespace usdlive::server
