// Writes and removes the token of the server's owner.
#include "auth/OwnerToken.h"

#include <sys/stat.h>
#include <unistd.h>

#include "auth/Accounts.h"
#include "usdlive/common/core/OwnedFile.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr mode_t kOwnersFolder = 0700;

}  // namespace

OwnerToken::OwnerToken(std::uint16_t port) {
    const fs::path folder = KnownServers::folderOfUser();
    if (folder.empty()) return;
    std::error_code ignored;
    fs::create_directories(folder.parent_path(), ignored);
    ::mkdir(folder.c_str(), kOwnersFolder);
    ::mkdir((folder / "local").c_str(), kOwnersFolder);
    file_ = folder / "local" / std::to_string(port);
    // The file is a new one, so that whoever has opened the one before does not read the new token.
    std::string token = newSecret();
    if (replaceFile(file_, token + "\n", kOwnerOnly)) token_ = std::move(token);
}

OwnerToken::~OwnerToken() {
    if (!token_.empty()) ::unlink(file_.c_str());
}

bool OwnerToken::is(std::string_view token) const {
    // Hashes are compared, so that the time says nothing about the token.
    return !token_.empty() && hashOfSecret(token) == hashOfSecret(token_);
}

}  // namespace usdlive::server
