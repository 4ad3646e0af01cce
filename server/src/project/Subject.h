// The user who acts in a project.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive::server {

/// The statements of an issuer about a user (AC22).
struct IssuedSignIn {
    std::set<std::string> groups;
    std::int64_t endsAt = 0;  ///< seconds since 1970
    Role role = Role::None;   ///< for users without an account of their name
};

/// Stands for a token where a certificate of DDS Security proves the user (DD17).
inline constexpr const char* kByCertificate = "certificate";

/// A signed-in user, as a transport passes it on.
struct SignedIn {
    /// Empty for the owner of the server's process, who may act in the name of any user.
    UserName user;
    Role role = Role::None;
    std::string token;                        ///< the id of the token that proved it, not the token
    std::optional<IssuedSignIn> issued = {};  ///< nothing for a token of this server
    std::optional<std::int64_t> endsAt = {};  ///< the end of such a token (AC12)

    /// Returns when the token ends, in seconds since 1970; nothing: when it is revoked.
    [[nodiscard]] std::optional<std::int64_t> end() const {
        return issued ? std::optional(issued->endsAt) : endsAt;
    }
};

/// The user of a session and what they may do.
struct Subject {
    UserName user;
    Role role = Role::Editor;
    /// Nothing if the server does not ask users to sign in: `user` is the name in the hello then.
    std::optional<SignedIn> proof = {};

    [[nodiscard]] const std::set<std::string>& groups() const {
        static const std::set<std::string> none;
        return proof && proof->issued ? proof->issued->groups : none;
    }
    [[nodiscard]] bool isAdministrator() const { return role == Role::Admin; }
};

/// Returns whose limits a session takes of (SE22, SE23): those of its user, or of the address of
/// its connection if nobody had to sign in. Nobody can choose it.
[[nodiscard]] inline std::string shareOf(const Subject& subject, const std::string& address) {
    if (!subject.proof) return "at " + address;
    const UserName& user = subject.proof->user;
    return user.empty() ? "owner" : "user " + user.value;
}

}  // namespace usdlive::server
