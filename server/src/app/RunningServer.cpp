// Records which process serves a folder, and finds the URLs of this machine.
#include "app/RunningServer.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <signal.h>
#include <unistd.h>

#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "usdlive/common/core/Descriptor.h"
#include "usdlive/common/net/KnownServers.h"

namespace usdlive::server {

namespace {

std::filesystem::path fileOf(const std::filesystem::path& folder) {
    return folder / ".usdlive" / "server.json";
}

}  // namespace

RunningServer::RunningServer(std::filesystem::path folder, const std::string& url)
    : file_(fileOf(folder)) {
    const std::string text = nlohmann::json{{"process", ::getpid()}, {"url", url}}.dump() + "\n";
    // O_NONBLOCK, so that a pipe of this name does not block.
    const Descriptor file(
        ::open(file_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NONBLOCK, 0644));
    if (!file) return;
    [[maybe_unused]] const ssize_t ignored = ::write(file.get(), text.data(), text.size());
}

RunningServer::~RunningServer() { ::unlink(file_.c_str()); }

std::optional<RunningServer::Where> RunningServer::find(const std::filesystem::path& folder) {
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(fileOf(folder), ignored)) return std::nullopt;
    std::ifstream file(fileOf(folder));
    const auto json = nlohmann::json::parse(file, nullptr, false);
    if (!json.is_object() || !json.contains("process") || !json["process"].is_number_integer() ||
        !json.contains("url") || !json["url"].is_string())
        return std::nullopt;
    Where where{json["process"].get<std::int64_t>(), json["url"].get<std::string>()};
    if (where.process <= 0 || ::kill(pid_t(where.process), 0) != 0) return std::nullopt;
    return where;
}

std::vector<std::string> ipv4Addresses() {
    ifaddrs* first = nullptr;
    if (::getifaddrs(&first) != 0) return {};
    const std::unique_ptr<ifaddrs, decltype(&::freeifaddrs)> all(first, ::freeifaddrs);
    std::vector<std::string> addresses;
    for (const ifaddrs* one = first; one; one = one->ifa_next) {
        if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET) continue;
        if ((one->ifa_flags & IFF_LOOPBACK) != 0 || (one->ifa_flags & IFF_UP) == 0) continue;
        char text[INET_ADDRSTRLEN];
        const auto* address = reinterpret_cast<const sockaddr_in*>(one->ifa_addr);
        if (::inet_ntop(AF_INET, &address->sin_addr, text, sizeof text))
            addresses.emplace_back(text);
    }
    return addresses;
}

std::vector<std::string> reachableUrls(const std::string& host, std::uint16_t port,
                                       bool isEncrypted) {
    const auto urlOf = [&](const std::string& name) {
        return (isEncrypted ? "wss://" : "ws://") + serverName(name, port);
    };
    if (host != "0.0.0.0" && host != "::") return {urlOf(host)};
    std::vector<std::string> urls;
    char name[256] = {};
    const auto addresses = ipv4Addresses();
    if (!addresses.empty() && ::gethostname(name, sizeof name - 1) == 0 && *name)
        urls.push_back(urlOf(name));
    for (const std::string& address : addresses) urls.push_back(urlOf(address));
    if (urls.empty()) urls.push_back(urlOf("127.0.0.1"));
    return urls;
}

}  // namespace usdlive::server
