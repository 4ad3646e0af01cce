// Reads and writes servers.json.
#include "usdlive/common/net/KnownServers.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <system_error>
#include <thread>
#include <utility>

#include "usdlive/common/core/OwnedFile.h"
#include "usdlive/common/net/Invitation.h"

namespace usdlive {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr const char* kFile = "servers.json";
constexpr const char* kServers = "servers";
constexpr const char* kRenewal = "renewal";
constexpr mode_t kPrivateFolder = 0700, kOthers = 0077;
constexpr std::size_t kMostTokenBytes = 4096;

std::string systemError() { return std::error_code(errno, std::generic_category()).message(); }

tl::unexpected<Error> failed(const std::string& what, const fs::path& path,
                             const std::string& why) {
    return fail(ErrorCode::InvalidConfiguration,
                "cannot " + what + " " + path.string() + ": " + why);
}

Result<std::string> readFile(const Descriptor& file, const fs::path& path) {
    std::string text;
    std::array<char, 4096> part;
    for (;;) {
        const ssize_t count = ::read(file.get(), part.data(), part.size());
        if (count < 0) return failed("read", path, systemError());
        if (count == 0) return text;
        text.append(part.data(), std::size_t(count));
    }
}

/// Returns the entries of the file; an empty object if there is none.
Result<Json> readServers(const fs::path& path) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (!file) {
        // A process that may not use the folder, such as a service with the variables of another
        // user, knows no server.
        const int error = errno;
        if (error == ENOENT || (error == EACCES && ::access(path.parent_path().c_str(), X_OK) != 0))
            return Json{{kServers, Json::object()}};
        errno = error;
        return failed("read", path, systemError());
    }
    struct stat status{};
    if (::fstat(file.get(), &status) != 0) return failed("read", path, systemError());
    if ((status.st_mode & kOthers) != 0)
        return failed("use", path,
                      "other users can read it, and it contains tokens. Run `chmod 600 " +
                          path.string() + "`");
    const auto text = readFile(file, path);
    if (!text) return tl::unexpected(text.error());
    Json all = Json::parse(*text, nullptr, false);
    if (!all.is_object() || !all.contains(kServers) || !all[kServers].is_object())
        return failed(
            "use", path,
            "it is not JSON with an object \"servers\". Correct it, or remove it and log in again");
    return all;
}

std::string textOf(const Json& entry, const char* name) {
    const auto found = entry.find(name);
    return found != entry.end() && found->is_string() ? found->get<std::string>() : "";
}

std::optional<TokenRenewal> renewalOf(const Json& entry) {
    const auto found = entry.find(kRenewal);
    if (found == entry.end() || !found->is_object()) return std::nullopt;
    const auto end = found->find("endsAt");
    return TokenRenewal{
        textOf(*found, "tokensUrl"), textOf(*found, "clientId"), textOf(*found, "refreshToken"),
        end != found->end() && end->is_number_integer() ? end->get<std::int64_t>() : 0};
}

KnownServer serverOf(const Json& entry) {
    if (!entry.is_object()) return {};
    const auto tls = entry.find("tls");
    return {textOf(entry, "user"), textOf(entry, "token"), textOf(entry, "pin"),
            tls != entry.end() && tls->is_boolean() && tls->get<bool>(), renewalOf(entry)};
}

/// The files are settings of the user, so an error is one of the configuration.
Error asConfiguration(const Error& error) {
    return {ErrorCode::InvalidConfiguration, error.message};
}

Result<void> makeFolder(const fs::path& folder) {
    std::error_code error;
    fs::create_directories(folder.parent_path(), error);
    if (::mkdir(folder.c_str(), kPrivateFolder) != 0 && errno != EEXIST)
        return failed("create", folder, systemError());
    return {};
}

/// Changes the file while no other process does. `change` returns whether it has changed anything.
Result<bool> changeServers(const fs::path& folder, const std::function<bool(Json&)>& change) {
    if (folder.empty())
        return fail(ErrorCode::InvalidConfiguration,
                    "no folder is known for the settings of usdlive. Set HOME or XDG_CONFIG_HOME");
    if (const auto made = makeFolder(folder); !made) return tl::unexpected(made.error());
    const auto lock = lockFile(folder / "servers.lock").map_error(asConfiguration);
    if (!lock) return tl::unexpected(lock.error());
    auto all = readServers(folder / kFile);
    if (!all) return tl::unexpected(all.error());
    if (!change((*all)[kServers])) return false;
    const auto written =
        replaceFile(folder / kFile, all->dump(2) + "\n", kOwnerOnly).map_error(asConfiguration);
    if (!written) return tl::unexpected(written.error());
    return true;
}

std::string lowerCase(std::string text) {
    for (char& character : text)
        if (character >= 'A' && character <= 'Z') character = char(character - 'A' + 'a');
    return text;
}

fs::path folderOf(const char* variable) {
    const char* value = std::getenv(variable);
    return value ? value : "";
}

/// Returns the text of a file with a secret, which nobody else may read.
Result<std::string> secretIn(const fs::path& path) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    struct stat status{};
    if (!file || ::fstat(file.get(), &status) != 0) return failed("read", path, systemError());
    if ((status.st_mode & kOthers) != 0)
        return failed("use", path,
                      "other users can read it, and it contains a token. Run `chmod 600 " +
                          path.string() + "`");
    return readFile(file, path);
}

/// Returns the token of a service account that the environment gives, if it does.
Result<std::optional<ServiceToken>> givenToken() {
    constexpr const char *kToken = "USDLIVE_TOKEN", *kTokenFile = "USDLIVE_TOKEN_FILE";
    const char* const text = std::getenv(kToken);
    const char* const file = std::getenv(kTokenFile);
    const bool isText = text && *text;
    if (!isText && !(file && *file)) return std::nullopt;
    const auto secret = isText ? Result<std::string>(text) : secretIn(file);
    if (!secret) return tl::unexpected(secret.error());
    auto token = parseServiceToken(*secret);
    if (!token)
        return fail(ErrorCode::InvalidConfiguration,
                    std::string(isText ? kToken : kTokenFile) + ": " + token.error().message);
    return *std::move(token);
}

}  // namespace

std::string serverName(const std::string& host, std::uint16_t port) {
    const std::string lower = lowerCase(host);
    const bool isBare = lower.find(':') != std::string::npos && !lower.starts_with('[');
    return (isBare ? "[" + lower + "]" : lower) + ":" + std::to_string(port);
}

bool isLoopbackHost(const std::string& host) {
    const std::string lower = lowerCase(host);
    return lower == "localhost" || lower.ends_with(".localhost") || lower == "::1" ||
           lower == "[::1]" ||
           (lower.starts_with("127.") &&
            lower.find_first_not_of("0123456789.") == std::string::npos);
}

fs::path KnownServers::folderOfUser() {
    if (const auto config = folderOf("XDG_CONFIG_HOME"); !config.empty()) return config / "usdlive";
    if (const auto home = folderOf("HOME"); !home.empty()) return home / ".config" / "usdlive";
    return {};
}

KnownServers::KnownServers(fs::path folder) : folder_(std::move(folder)) {}

Result<std::optional<KnownServer>> KnownServers::find(const std::string& host,
                                                      std::uint16_t port) const {
    const auto token = givenToken();
    if (!token) return tl::unexpected(token.error());
    auto known = kept(host, port);
    if (!known || !*token) return known;
    const auto& [user, place] = **token;
    if (serverName(place.host, place.port) != serverName(host, port)) return known;
    KnownServer server = known->value_or(KnownServer());
    server.user = user;
    server.token = place.code;
    server.isTls = server.isTls || place.isTls;
    if (!place.pin.empty()) server.pin = place.pin;
    server.renewal.reset();
    return server;
}

Result<std::optional<KnownServer>> KnownServers::kept(const std::string& host,
                                                      std::uint16_t port) const {
    if (folder_.empty()) return std::nullopt;
    const auto all = readServers(folder_ / kFile);
    if (!all) return tl::unexpected(all.error());
    const Json& servers = (*all)[kServers];
    const auto found = servers.find(serverName(host, port));
    if (found == servers.end()) return std::nullopt;
    return serverOf(*found);
}

Result<void> KnownServers::update(const std::string& host, std::uint16_t port,
                                  const std::function<void(KnownServer&)>& change) const {
    const auto done = changeServers(folder_, [&](Json& servers) {
        Json& entry = servers[serverName(host, port)];  // with members of later versions
        const KnownServer old = serverOf(entry);
        KnownServer server = old;
        change(server);
        if (entry.is_object() && server == old) return false;
        if (!entry.is_object()) entry = Json::object();
        for (const auto& [name, text] :
             {std::pair{"user", &server.user}, {"token", &server.token}, {"pin", &server.pin}}) {
            if (text->empty())
                entry.erase(name);
            else
                entry[name] = *text;
        }
        entry["tls"] = server.isTls;
        if (server.renewal)
            entry[kRenewal] = {{"tokensUrl", server.renewal->tokensUrl},
                               {"clientId", server.renewal->clientId},
                               {"refreshToken", server.renewal->refreshToken},
                               {"endsAt", server.renewal->endsAt}};
        else
            entry.erase(kRenewal);
        return true;
    });
    if (!done) return tl::unexpected(done.error());
    return {};
}

Result<void> KnownServers::keep(const std::string& host, std::uint16_t port,
                                const KnownServer& server) const {
    return update(host, port, [&](KnownServer& known) { known = server; });
}

Result<bool> KnownServers::forget(const std::string& host, std::uint16_t port) const {
    return changeServers(folder_,
                         [&](Json& servers) { return servers.erase(serverName(host, port)) > 0; });
}

std::optional<std::string> KnownServers::ownerToken(std::uint16_t port) const {
    if (folder_.empty()) return std::nullopt;
    const fs::path path = folder_ / "local" / std::to_string(port);
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    struct stat status{};
    if (!file || ::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode) ||
        status.st_uid != ::geteuid() || (status.st_mode & kOthers) != 0)
        return std::nullopt;
    std::array<char, kMostTokenBytes> part;
    const ssize_t count = ::read(file.get(), part.data(), part.size());
    std::string token(part.data(), std::size_t(count > 0 ? count : 0));
    token.erase(token.find_last_not_of(" \r\n") + 1);
    if (token.empty()) return std::nullopt;
    return token;
}

Result<std::optional<Descriptor>> KnownServers::lockRenewal(
    std::chrono::milliseconds limit, const std::function<bool()>& isStopped) const {
    constexpr std::chrono::milliseconds kLook{20};
    if (const auto made = makeFolder(folder_); !made) return tl::unexpected(made.error());
    const auto end = std::chrono::steady_clock::now() + limit;
    for (;;) {
        auto lock = tryLockFile(folder_ / "renewal.lock").map_error(asConfiguration);
        if (!lock || *lock) return lock;
        if (std::chrono::steady_clock::now() >= end || (isStopped && isStopped()))
            return std::nullopt;
        std::this_thread::sleep_for(kLook);
    }
}

Result<std::optional<std::string>> KnownServers::authorization(const std::string& host,
                                                               std::uint16_t port,
                                                               bool isEncrypted) const {
    const auto known = find(host, port);
    if (!known) return tl::unexpected(known.error());
    if (*known && !(*known)->token.empty() && (isEncrypted || !(*known)->isTls))
        return "Bearer " + (*known)->token;
    if (isLoopbackHost(host))
        if (const auto token = ownerToken(port)) return "Bearer " + *token;
    return std::nullopt;
}

}  // namespace usdlive
