// Reads and replaces the file of the accounts.
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <system_error>

#include "auth/Accounts.h"
#include "auth/FileStamp.h"
#include "usdlive/common/core/OwnedFile.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

tl::unexpected<Error> failedTo(const std::string& what, const fs::path& path) {
    return fail(ErrorCode::StorageFailed,
                "cannot " + what + " " + path.string() + ": " + std::strerror(errno));
}

}  // namespace

AccountsFile::AccountsFile(const fs::path& folder) : path_(folder / ".usdlive" / "users.json") {}

Result<std::optional<Accounts>> AccountsFile::read() const {
    struct stat found{};
    if (::stat(path_.c_str(), &found) != 0) {
        if (errno == ENOENT || errno == ENOTDIR) return std::nullopt;
        return failedTo("read", path_);
    }
    const auto unusable = [this](const std::string& why) {
        return fail(ErrorCode::InvalidConfiguration, path_.string() + ": " + why);
    };
    if (!S_ISREG(found.st_mode)) return unusable("it is not a regular file");
    if ((found.st_mode & 0077) != 0)
        return unusable("other users of this machine may read it. Run: chmod 600 " +
                        path_.string());
    std::ifstream file(path_, std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    if (!file) return failedTo("read", path_);
    auto accounts = Accounts::parse(text);
    if (!accounts) return unusable(accounts.error().message);
    return std::move(*accounts);
}

Result<Accounts> AccountsFile::change(const std::function<Result<void>(Accounts&)>& change) const {
    std::error_code error;
    fs::create_directories(path_.parent_path(), error);
    const auto lock = lockFile(path_.string() + ".lock");
    if (!lock) return tl::unexpected(lock.error());
    auto present = read();
    if (!present) return tl::unexpected(present.error());
    Accounts accounts = present->value_or(Accounts());
    if (const auto done = change(accounts); !done) return tl::unexpected(done.error());
    ++accounts.version_;
    if (auto written = replaceFile(path_, accounts.text(), kOwnerOnly); !written)
        return tl::unexpected(written.error());
    return accounts;
}

std::optional<std::string> AccountsFile::stamp() const { return changeStampOf(path_); }

}  // namespace usdlive::server
