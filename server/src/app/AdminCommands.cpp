// Runs and records the commands of administrators.
#include "app/AdminCommands.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <iostream>

#include "auth/Accounts.h"
#include "auth/AuditFile.h"
#include "usdlive/common/core/AccountName.h"

namespace usdlive::server {

namespace fs = std::filesystem;

namespace {

constexpr int kCommandFailed = 1, kWordsWrong = 2;

/// Returns the exit code, or that of an error if the output could not be written.
int adminCommandEnded(const std::string& name, int code) {
    if (std::cout.flush()) return code;
    std::cerr << name << ": standard output cannot be written\n";
    return kCommandFailed;
}

}  // namespace

int runAdminCommand(CLI::App& app, int argc, const char* const* argv,
                    const std::function<Result<void>()>& chosen) {
    const std::string name = app.get_name();
    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& asked) {
        return adminCommandEnded(name, app.exit(asked));
    } catch (const CLI::Error& error) {
        std::cerr << name << ": " << error.what() << "\n";
        return kWordsWrong;
    }
    const auto done = chosen();
    if (!done) std::cerr << name << ": " << done.error().message << "\n";
    return adminCommandEnded(name, done ? 0 : kCommandFailed);
}

fs::path accountsFolderOf(const fs::path& folder) {
    std::error_code error;
    const fs::path real = fs::canonical(folder, error);
    for (const fs::path& place : {real, real.parent_path()})
        if (fs::exists(AccountsFile(place).path(), error)) return place;
    return real;
}

std::string projectNameOf(const fs::path& folder) {
    std::error_code ignored;
    return fs::canonical(folder, ignored).filename().string();
}

Result<void> recordCommand(const fs::path& accountsFolder, std::string_view event,
                           const std::string& detail, const std::string& project) {
    const AuditEvent recorded{
        .event = event,
        .user = accountName(::getuid()).value_or("uid " + std::to_string(::getuid())),
        .from = "command line",
        .project = project,
        .detail = detail,
        .timeMs = auditTime()};
    const auto appended = AuditFile(accountsFolder).append({&recorded, 1});
    if (appended) return {};
    return fail(ErrorCode::StorageFailed,
                "it is done, but not in the audit log: " + appended.error().message);
}

}  // namespace usdlive::server
