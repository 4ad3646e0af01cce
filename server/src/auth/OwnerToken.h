// The token with which the owner of the server's process signs in on the same machine.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "usdlive/common/core/Hash.h"

namespace usdlive::server {

/// Writes a new token to `usdlive/local/PORT` in the owner's configuration folder, which nobody
/// else can read, and removes it in the end. Programs of the owner read it there. Without such a
/// folder the owner signs in as other users do.
class OwnerToken {
public:
    explicit OwnerToken(std::uint16_t port);
    ~OwnerToken();
    OwnerToken(const OwnerToken&) = delete;
    OwnerToken& operator=(const OwnerToken&) = delete;

    [[nodiscard]] bool is(std::string_view token) const;

private:
    std::filesystem::path file_;
    std::string token_;  ///< empty if it could not be written
};

}  // namespace usdlive::server
