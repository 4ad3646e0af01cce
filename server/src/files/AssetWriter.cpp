// Writes a new file into a project's folder, whole or not at all.
#include "files/AssetWriter.h"

#include <fcntl.h>
#include <stdio.h>  // renameat2
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <random>
#include <utility>
#include <vector>

#include "files/FileStamps.h"
#include "files/FolderWalk.h"
#include "files/SafeFile.h"
#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/core/LayerPath.h"
#include "usdlive/common/core/Utf8.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kWrittenAtOnce = 1024 * 1024;
constexpr mode_t kNewFolderMode = 0777;  // the process's umask applies

tl::unexpected<Error> invalid(const std::string& path, const std::string& why) {
    return fail(ErrorCode::InvalidFileName, inQuotes(path) + " " + why);
}

/// Returns true if the disk is full, or a limit of the user's or of the process is reached.
bool isFull(int error) { return error == ENOSPC || error == EDQUOT || error == EFBIG; }

tl::unexpected<Error> notWritten(const std::string& what) {
    return fail(isFull(errno) ? ErrorCode::StorageFull : ErrorCode::SaveFailed,
                what + ": " + std::strerror(errno));
}

/// The folder of a new file, and those above it that had to be created. The destructor removes
/// created folders that are empty.
class TargetFolder {
public:
    static Result<TargetFolder> open(const fs::path& root, const fs::path& folder) {
        TargetFolder target;
        Descriptor now(::open(root.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
        if (!now) return notWritten("the project's folder cannot be opened");
        for (const fs::path& part : folder) {
            auto next = enter(now.get(), part);
            bool isNew = false;
            if (!next && errno == ENOENT) {
                isNew = ::mkdirat(now.get(), part.c_str(), kNewFolderMode) == 0;
                if (!isNew && errno != EEXIST)
                    return notWritten("its folder " + inQuotes(folder.native()) +
                                      " cannot be created");
                if (isNew && ::fsync(now.get()) != 0)
                    return notWritten("its folder cannot be synced to the disk");
                next = enter(now.get(), part);
            }
            if (!next)
                return notWritten("its folder " + inQuotes(folder.native()) + " cannot be opened");
            if (isNew) target.created_.emplace_back(std::move(now), part);
            now = std::move(next);
        }
        target.here_ = std::move(now);
        return target;
    }
    TargetFolder(TargetFolder&&) noexcept = default;
    TargetFolder& operator=(TargetFolder&&) = delete;
    ~TargetFolder() {
        for (auto one = created_.rbegin(); one != created_.rend(); ++one)
            ::unlinkat(one->first.get(), one->second.c_str(), AT_REMOVEDIR);
    }
    [[nodiscard]] int get() const { return here_.get(); }

private:
    TargetFolder() = default;
    static Descriptor enter(int folder, const fs::path& part) {
        return Descriptor(
            ::openat(folder, part.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
    }

    Descriptor here_;
    std::vector<std::pair<Descriptor, fs::path>> created_;  // by the folder above
};

/// A file without its final name. The destructor removes it, unless it got its name.
class UnnamedAsset {
public:
    static Result<UnnamedAsset> create(int folder) {
        std::random_device random;
        for (int left = 100; left > 0; --left) {
            std::array<char, 17> digits{};
            std::snprintf(digits.data(), digits.size(), "%08x%08x", random(), random());
            std::string name = std::string(kTemporaryPrefix) + digits.data();
            Descriptor file(
                ::openat(folder, name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
            if (file) return UnnamedAsset(folder, std::move(name), std::move(file));
            if (errno != EEXIST) break;
        }
        return notWritten("its folder is not writable");
    }
    UnnamedAsset(UnnamedAsset&& other) noexcept
        : folder_(other.folder_),
          name_(std::exchange(other.name_, {})),
          file_(std::move(other.file_)) {}
    UnnamedAsset& operator=(UnnamedAsset&&) = delete;
    ~UnnamedAsset() {
        if (!name_.empty()) ::unlinkat(folder_, name_.c_str(), 0);
    }

    Result<void> write(const AssetContents& contents, mode_t mode) {
        // Finds out about a full disk before the content is copied.
        if (contents.size > 0 && ::fallocate(file_.get(), 0, 0, off_t(contents.size)) != 0 &&
            isFull(errno))
            return notWritten("there is no space for it on the disk of the project's folder");
        for (std::uint64_t at = 0; at < contents.size;) {
            const auto part = contents.read(
                at, std::size_t(std::min<std::uint64_t>(contents.size - at, kWrittenAtOnce)));
            if (!part) return tl::unexpected(part.error());
            if (part->empty()) return fail(ErrorCode::SaveFailed, "its content ends too early");
            if (auto added = append(*part); !added) return added;
            at += part->size();
        }
        if (::fchmod(file_.get(), mode) != 0) return notWritten("cannot get its permissions");
        if (::fsync(file_.get()) != 0) return notWritten("cannot be synced to the disk");
        return {};
    }

    Result<FileTrace> rename(const std::string& name, bool overwrite) {
        const bool isNamed = overwrite
                                 ? ::renameat(folder_, name_.c_str(), folder_, name.c_str()) == 0
                                 : renameToNew(name);
        if (!isNamed && errno == EEXIST && !overwrite)
            return fail(ErrorCode::FileExists, "the project has a file of this name");
        if (!isNamed) return notWritten("cannot get its name");
        name_.clear();
        struct stat status{};
        if (::fstat(file_.get(), &status) != 0 || ::fsync(folder_) != 0)
            return notWritten("its folder cannot be synced to the disk");
        return traceOf(status);
    }

private:
    UnnamedAsset(int folder, std::string name, Descriptor file)
        : folder_(folder), name_(std::move(name)), file_(std::move(file)) {}

    Result<void> append(const Bytes& part) {
        for (std::size_t done = 0; done < part.size();) {
            const ssize_t count = ::write(file_.get(), part.data() + done, part.size() - done);
            if (count < 0 && errno == EINTR) continue;
            if (count < 0) return notWritten("it cannot be written");
            done += std::size_t(count);
        }
        return {};
    }

    // Some file systems know no renameat2.
    bool renameToNew(const std::string& name) {
        if (::renameat2(folder_, name_.c_str(), folder_, name.c_str(), RENAME_NOREPLACE) == 0)
            return true;
        if (errno != EINVAL && errno != ENOSYS) return false;
        if (::linkat(folder_, name_.c_str(), folder_, name.c_str(), 0) != 0) return false;
        ::unlinkat(folder_, name_.c_str(), 0);
        return true;
    }

    int folder_;
    std::string name_;  // empty: it has its final name
    Descriptor file_;
};

}  // namespace

Result<AssetPlace> placeOfAsset(const fs::path& root, const std::string& path) {
    fs::path real = root;
    const fs::path name(path);
    std::error_code problem;
    for (auto part = name.begin(); part != name.end(); ++part) {
        real /= *part;
        if (fs::symlink_status(real, problem).type() == fs::file_type::symlink) {
            const fs::path target = fs::canonical(real, problem);
            if (problem) return invalid(path, "is reached over a broken link: remove the link");
            if (const auto why = whyOutside(root, target); !why.empty())
                return invalid(path, "is reached over a link that leads " + why);
            real = target;
        }
        const auto type = fs::status(real, problem).type();
        const bool isLast = std::next(part) == name.end();
        if (type == fs::file_type::not_found) continue;
        if (type == fs::file_type::none)
            return fail(ErrorCode::SaveFailed,
                        inQuotes(path) + " could not be written: " + problem.message());
        if (!isLast && type != fs::file_type::directory)
            return invalid(path, "is below " + inQuotes(part->native()) +
                                     ", which is no folder: choose another name");
        if (isLast && type == fs::file_type::directory)
            return invalid(path, "is a folder: add the file's name");
        if (isLast && type != fs::file_type::regular)
            return invalid(path, "is something else than a file: choose another name");
    }
    const fs::path inside = real.lexically_relative(root);
    if (parseLayerId(inside.native()))
        return invalid(path, "is a link to the layer " + inQuotes(inside.native()) +
                                 ": choose another name, or edit the layer");
    AssetPlace place{inside.parent_path(), inside.filename().native()};
    struct stat present{};
    if (::lstat(real.c_str(), &present) == 0) place.present = present;
    return place;
}

Result<FileTrace> writeAsset(const fs::path& root, const AssetPlace& place,
                             const AssetContents& contents, bool overwrite,
                             const std::function<Result<void>()>& ready) {
    if (overwrite && place.present &&
        !isWritable(root / place.folder / place.name, place.present->st_mode))
        return fail(ErrorCode::SaveFailed, "the file is read-only on the server");
    const auto folder = TargetFolder::open(root, place.folder);
    if (!folder) return tl::unexpected(folder.error());
    auto file = UnnamedAsset::create(folder->get());
    if (!file) return tl::unexpected(file.error());
    const mode_t mode = permissionsLike(place.present ? &*place.present : nullptr);
    return file->write(contents, mode).and_then(ready).and_then([&] {
        return file->rename(place.name, overwrite);
    });
}

}  // namespace usdlive::server
