// Copies folders, and shares files that never change.
#include "app/CopiedFolder.h"

namespace usdlive::server {

namespace fs = std::filesystem;

tl::unexpected<Error> cannotCopy(const fs::path& path, const std::error_code& error) {
    return fail(
        error == std::errc::no_space_on_device ? ErrorCode::StorageFull : ErrorCode::StorageFailed,
        "cannot copy " + path.string() + ": " + error.message());
}

namespace {

/// Copies a file that can be changed meanwhile, or `shares` one that never changes.
Result<void> copyFile(const fs::path& file, const fs::path& to, bool shares, Copied& copied) {
    std::error_code error;
    if (shares) fs::create_hard_link(file, to, error);
    if (!shares || error) {
        error.clear();
        fs::copy_file(file, to, error);
    }
    std::error_code gone;
    if (error && !fs::exists(fs::symlink_status(file, gone))) return {};  // it was removed
    if (error) return cannotCopy(file, error);
    ++copied.files;
    copied.bytes += fs::file_size(to, gone);
    return {};
}

}  // namespace

Result<void> copyFolder(const fs::path& from, const fs::path& to, bool shares, Copied& copied,
                        const std::function<bool(const fs::path&)>& isLeftOut) {
    std::error_code error;
    fs::create_directory(to, from, error);
    if (error) return cannotCopy(to, error);
    for (fs::directory_iterator entry(from, error), end; !error && entry != end;
         entry.increment(error)) {
        const fs::path name = entry->path().filename();
        if (isLeftOut && isLeftOut(name)) continue;
        std::error_code ignored;
        const fs::file_status status = entry->symlink_status(ignored);
        Result<void> done;
        if (fs::is_symlink(status)) {
            fs::copy_symlink(entry->path(), to / name, ignored);
            if (ignored) done = cannotCopy(entry->path(), ignored);
        } else if (fs::is_directory(status)) {
            done = copyFolder(entry->path(), to / name, shares, copied);
        } else if (fs::is_regular_file(status)) {
            done = copyFile(entry->path(), to / name, shares, copied);
        }
        if (!done) return done;
    }
    return error ? Result<void>(cannotCopy(from, error)) : Result<void>();
}

}  // namespace usdlive::server
