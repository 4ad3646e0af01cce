// Copies a project while it is served, and checks the copy.
#include "app/BackupCommand.h"

#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <functional>
#include <iostream>
#include <string>
#include <thread>

#include "app/AdminCommands.h"
#include "app/CopiedFolder.h"
#include "app/LiveSessionFolder.h"
#include "app/RunningServer.h"
#include "app/StoreCopyFile.h"
#include "storage/RocksCommitStore.h"
#include "usdlive/common/core/Descriptor.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr std::chrono::milliseconds kCopyLook{20};
// The hash chain of the whole copy is checked.
constexpr std::chrono::hours kVerifyTime{24};
constexpr const char* kPartOfBackup = ".part";
constexpr std::chrono::hours kLongest{24};
// The server copies a store in a moment. It may have ended a live session meanwhile.
constexpr std::chrono::seconds kLongestForSession{60};

struct Backup {
    fs::path folder, target;
};

tl::unexpected<Error> noBackup(const std::string& why) {
    return fail(ErrorCode::InvalidArgument, why);
}

/// Removes an unfinished backup.
class Draft {
public:
    explicit Draft(fs::path path) : path_(std::move(path)) {}
    ~Draft() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
    }
    Draft(const Draft&) = delete;
    Draft& operator=(const Draft&) = delete;

    [[nodiscard]] const fs::path& path() const { return path_; }
    /// Writes everything to the disk, and gives the folder its name.
    [[nodiscard]] Result<void> finish(const fs::path& name) {
        const Descriptor folder(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
        if (!folder || ::syncfs(folder.get()) != 0)
            return cannotCopy(path_, std::error_code(errno, std::generic_category()));
        std::error_code error;
        fs::rename(path_, name, error);
        if (error) return cannotCopy(name, error);
        path_.clear();
        return {};
    }

private:
    fs::path path_;
};

/// Waits until the server that runs in a folder has made a copy of a store. Returns where it is.
Result<fs::path> askServer(const fs::path& folder, const fs::path& history,
                           std::chrono::seconds most) {
    const StoreCopyFile file(history);
    const auto end = std::chrono::steady_clock::now() + most;
    const auto name = file.ask();
    if (!name) return tl::unexpected(name.error());
    for (;;) {
        if (const auto answer = file.answer(*name)) {
            if (!*answer) return tl::unexpected(answer->error());
            return file.copy(*name);
        }
        if (!RunningServer::find(folder))
            return fail(ErrorCode::StorageFailed,
                        "the server has ended before it had copied its store; try again");
        if (std::chrono::steady_clock::now() > end)
            return fail(ErrorCode::StorageFailed, "the server does not copy the store in " +
                                                      history.string() + "; try again");
        std::this_thread::sleep_for(kCopyLook);
    }
}

Result<void> copyServedStore(const fs::path& folder, const fs::path& history, const fs::path& to,
                             std::chrono::seconds most, Copied& copied) {
    const auto made = askServer(folder, history, most);
    if (!made) return tl::unexpected(made.error());
    const Draft copy(*made);
    std::error_code error;
    fs::rename(copy.path(), to, error);
    return error ? copyFolder(copy.path(), to, false, copied) : Result<void>();
}

Result<void> copyStore(const fs::path& folder, const fs::path& to, Copied& copied) {
    const fs::path history = folder / ".usdlive";
    if (RunningServer::find(folder)) return copyServedStore(folder, history, to, kLongest, copied);
    const auto store = createRocksCommitStore(history / "store");
    if (!store) return tl::unexpected(store.error());
    return (*store)->copyTo(to);
}

/// Opens the copy, which checks its whole history. Returns its newest revision.
Result<Revision> verified(const fs::path& store) {
    RocksCommitStoreOptions options;
    options.verifyTime = kVerifyTime;
    const auto opened = createRocksCommitStore(store, options);
    if (!opened) return tl::unexpected(opened.error());
    return (*opened)->head().revision;
}

/// Copies a live session. Its record is first: a merge that is noted later is not in the copy, and
/// one that is noted there and was not committed was not done (LV7).
Result<void> copySession(const fs::path& folder, const fs::path& from, const fs::path& to,
                         Copied& copied) {
    std::error_code error;
    fs::create_directories(to, error);
    if (!error) fs::copy_file(from / "session.json", to / "session.json", error);
    if (error) return cannotCopy(from, error);
    const auto store = createRocksCommitStore(from / "store");  // it is ended, or nobody serves
    const bool isServed = !store && store.error().code == ErrorCode::StorageLocked;
    if (!store && !isServed) return tl::unexpected(store.error());
    const auto done = isServed
                          ? copyServedStore(folder, from, to / "store", kLongestForSession, copied)
                          : (*store)->copyTo(to / "store");
    if (!done) return done;
    if (const auto checked = verified(to / "store"); !checked)
        return tl::unexpected(checked.error());
    if (!fs::exists(from / "blobs", error)) return {};
    return copyFolder(from / "blobs", to / "blobs", true, copied,
                      [](const fs::path& name) { return name == "unfinished"; });
}

/// Copies the live sessions, and returns how many. It says which one cannot be copied; the backup
/// is made without it.
Result<std::size_t> copySessions(const fs::path& folder, const fs::path& to, Copied& copied) {
    const fs::path from = folder / ".usdlive" / "sessions", target = to / ".usdlive" / "sessions";
    std::size_t count = 0;
    for (const LiveSessionRecord& one : LiveSessionFolder(folder).list()) {
        const auto done = copySession(folder, from / one.name, target / one.name, copied);
        if (done) ++count;
        if (done) continue;
        if (done.error().code == ErrorCode::StorageFull) return tl::unexpected(done.error());
        std::error_code ignored;
        fs::remove_all(target / one.name, ignored);
        std::cerr << "usdlive: the live session " << one.name
                  << " is not in the backup: " << done.error().message << "\n";
    }
    return count;
}

bool isOfRunningServer(const fs::path& name) {
    const std::string text = name.string();
    return text == "store" || text == "blobs" || text == "sessions" || text == "server.json" ||
           text.starts_with("copy") || text.ends_with(".taken") || text.ends_with(".new");
}

Result<void> checkPlaces(const Backup& wanted) {
    std::error_code error;
    if (!fs::is_directory(wanted.folder / ".usdlive" / "store", error))
        return noBackup(wanted.folder.string() +
                        " has no history yet: nobody has served it. Copy its files");
    if (fs::exists(fs::symlink_status(wanted.target, error)))
        return noBackup(wanted.target.string() + " exists; name a new folder");
    const fs::path real = fs::canonical(wanted.folder, error);
    const fs::path parent = fs::weakly_canonical(fs::absolute(wanted.target), error);
    for (fs::path above = parent; above != above.root_path(); above = above.parent_path())
        if (above == real)
            return noBackup("a backup cannot be in the folder that it is of: " +
                            wanted.target.string());
    if (!fs::is_directory(parent.parent_path(), error))
        return noBackup("there is no folder " + parent.parent_path().string());
    return {};
}

Result<void> backUp(Backup wanted) {
    while (!wanted.target.has_filename() && wanted.target.has_parent_path())
        wanted.target = wanted.target.parent_path();  // a slash at the end
    if (const auto fits = checkPlaces(wanted); !fits) return fits;
    Draft draft(wanted.target.string() + kPartOfBackup);
    const fs::path& to = draft.path();
    const fs::path from = wanted.folder / ".usdlive";
    std::error_code error;
    fs::remove_all(to, error);  // left by a killed backup
    Copied copied;
    fs::create_directory(to, wanted.folder, error);
    if (!error) fs::create_directory(to / ".usdlive", from, error);
    if (error) return cannotCopy(to, error);
    // A live session may have received what the main line has: the main line is copied later. Of
    // each, the store is first: it names the big values and files that are copied after it.
    const auto sessions = copySessions(wanted.folder, to, copied);
    if (!sessions) return tl::unexpected(sessions.error());
    if (auto done = copyStore(wanted.folder, to / ".usdlive" / "store", copied); !done) return done;
    const auto revision = verified(to / ".usdlive" / "store");
    if (!revision) return tl::unexpected(revision.error());
    const auto isHistory = [](const fs::path& name) { return name == ".usdlive"; };
    const auto isUnfinished = [](const fs::path& name) { return name == "unfinished"; };
    auto done = copyFolder(from / "blobs", to / ".usdlive" / "blobs", true, copied, isUnfinished);
    if (!fs::exists(from / "blobs", error)) done = {};
    if (done) done = copyFolder(from, to / ".usdlive", false, copied, isOfRunningServer);
    if (done) done = copyFolder(wanted.folder, to, false, copied, isHistory);
    if (done) done = draft.finish(wanted.target);
    if (!done) return done;
    constexpr std::uint64_t kMib = 1 << 20;
    std::cout << wanted.target.string() << " has the project at revision " << *revision
              << (*sessions > 0 ? ", " + std::to_string(*sessions) +
                                      (*sessions == 1 ? " live session" : " live sessions")
                                : std::string())
              << ", with " << copied.files << " files of " << (copied.bytes + kMib - 1) / kMib
              << " MiB. Serve it with: usdlive serve " << wanted.target.string() << "\n";
    return recordCommand(accountsFolderOf(wanted.folder), "backup made", wanted.target.string(),
                         projectNameOf(wanted.folder));
}

}  // namespace

int runBackupCommand(int argc, const char* const* argv) {
    Backup wanted;
    CLI::App app("Copies a project with its history, also while it is served and edited.",
                 kBackupCommand);
    app.footer(R"(
The copy has everything that was confirmed to an editor before the command began, also in live sessions. Its history is
checked. It is a project of its own: serve it where it is, or in place of one that was lost.

Example:
  usdlive backup shots/s010 /backup/s010-monday)");
    app.add_option("DIR", wanted.folder, "The folder of the project")
        ->required()
        ->check(CLI::ExistingDirectory.description(""))
        ->type_name("");
    app.add_option("TARGET", wanted.target, "A new folder outside DIR")->required()->type_name("");
    return runAdminCommand(app, argc, argv, [&] { return backUp(wanted); });
}

}  // namespace usdlive::server
