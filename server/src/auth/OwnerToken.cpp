// Writes and removes the token of the server's owner.
#include "usdlive/server/auth/OwnerToken.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/server/auth/Accounts.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr mode_t kTokenMode = 0600, kOwnersFolder = 0700;

/// Returns the folder of the user's configuration; empty if there is none.
fs::path configurationFolder() {
    const char* folder = std::getenv("XDG_CONFIG_HOME");
    if (folder && *folder == '/') return folder;
    const char* home = std::getenv("HOME");
    return home && *home == '/' ? fs::path(home) / ".config" : fs::path();
}

}  // namespace

OwnerToken::OwnerToken(std::uint16_t port) {
    const fs::path folder = configurationFolder();
    if (folder.empty()) return;
    std::error_code ignored;
    fs::create_directories(folder, ignored);
    ::mkdir((folder / "usdlive").c_str(), kOwnersFolder);
    ::mkdir((folder / "usdlive" / "local").c_str(), kOwnersFolder);
    file_ = folder / "usdlive" / "local" / std::to_string(port);
    // A new file, so that whoever has opened the one before does not read the new token.
    ::unlink(file_.c_str());
    const Descriptor file(
        ::open(file_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, kTokenMode));
    std::string token = newSecret();
    const std::string line = token + "\n";
    if (file && ::write(file.get(), line.data(), line.size()) == ssize_t(line.size()))
        token_ = std::move(token);
}

OwnerToken::~OwnerToken() {
    if (!token_.empty()) ::unlink(file_.c_str());
}

bool OwnerToken::is(std::string_view token) const {
    // Hashes are compared, so that the time says nothing about the token.
    return !token_.empty() && hashOfSecret(token) == hashOfSecret(token_);
}

}  // namespace usdlive::server
