// The file with the keys of an issuer.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "auth/OpenIdConnect.h"

namespace usdlive::server {

/// The file of `--oidc-jwks`, a JWK Set. Any thread; blocks for the disk.
class IssuerKeysFile {
public:
    explicit IssuerKeysFile(std::filesystem::path path) : path_(std::move(path)) {}

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Error: InvalidConfiguration names the file and what is wrong.
    [[nodiscard]] Result<IssuerKeys> read() const;
    /// Returns a value that differs when the file was changed; nothing if it cannot be found.
    [[nodiscard]] std::optional<std::string> stamp() const;

private:
    std::filesystem::path path_;
};

}  // namespace usdlive::server
