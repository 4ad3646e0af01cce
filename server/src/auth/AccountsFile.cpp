// Reads and replaces the file of the accounts.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <system_error>

#include "FileStamp.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/server/auth/Accounts.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr mode_t kOwnerOnly = 0600;

tl::unexpected<Error> failedTo(const std::string& what, const fs::path& path) {
    return fail(ErrorCode::StorageFailed,
                "cannot " + what + " " + path.string() + ": " + std::strerror(errno));
}

Result<void> writeWhole(const Descriptor& file, std::string_view text, const fs::path& path) {
    while (!text.empty()) {
        const ssize_t count = ::write(file.get(), text.data(), text.size());
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return failedTo("write", path);
        text.remove_prefix(std::size_t(count));
    }
    if (::fsync(file.get()) != 0) return failedTo("write", path);
    return {};
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
    const fs::path lockPath = path_.string() + ".lock";
    const Descriptor lock(::open(lockPath.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kOwnerOnly));
    if (!lock || ::flock(lock.get(), LOCK_EX) != 0) return failedTo("lock", lockPath);
    auto present = read();
    if (!present) return tl::unexpected(present.error());
    Accounts accounts = present->value_or(Accounts());
    if (const auto done = change(accounts); !done) return tl::unexpected(done.error());
    ++accounts.version_;
    const fs::path draft = path_.string() + ".new";
    const Descriptor file(
        ::open(draft.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kOwnerOnly));
    if (!file || ::fchmod(file.get(), kOwnerOnly) != 0) return failedTo("write", draft);
    if (auto written = writeWhole(file, accounts.text(), draft); !written)
        return tl::unexpected(written.error());
    if (std::rename(draft.c_str(), path_.c_str()) != 0) return failedTo("replace", path_);
    const Descriptor folder(
        ::open(path_.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (folder) ::fsync(folder.get());
    return accounts;
}

std::optional<std::string> AccountsFile::stamp() const { return changeStampOf(path_); }

}  // namespace usdlive::server
