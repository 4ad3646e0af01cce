// The user who acts in a project.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "usdlive/common/core/Id.h"
#include "usdlive/common/protocol/Role.h"

namespace usdlive::server {

/// A signed-in user, as a transport passes it on.
struct SignedIn {
    /// Empty for the owner of the server's process, who may act in the name of any user.
    UserName user;
    Role role = Role::None;
    std::string token;                  ///< the id of the token that proved it, not the token
    std::set<std::string> groups = {};  ///< those of the issuer; empty for others (AC22)
    /// The end of the sign-in, in seconds since 1970; nothing: it lasts until it is revoked.
    std::optional<std::int64_t> endsAt = {};
};

/// The user of a session and what they may do.
struct Subject {
    UserName user;
    Role role = Role::Editor;
    /// Nothing if the server does not ask users to sign in: `user` is the name in the hello then.
    std::optional<SignedIn> proof = {};

    [[nodiscard]] const std::set<std::string>& groups() const {
        static const std::set<std::string> none;
        return proof ? proof->groups : none;
    }
    [[nodiscard]] bool isAdministrator() const { return role == Role::Admin; }
};

}  // namespace usdlive::server
