// Loads the certificate that the options name, or creates one.
#include "app/TlsOptions.h"

#include <algorithm>

#include "app/RunningServer.h"
#include "transport/HostNames.h"

namespace usdlive::server {

namespace {

/// Returns the names and addresses for a certificate of our own.
std::vector<std::string> certifiedNames(const std::vector<std::string>& hosts) {
    std::vector<std::string> names{"127.0.0.1", "::1"};
    const auto add = [&names](const std::string& host) {
        if (const auto name = hostOf(host); name && std::ranges::find(names, *name) == names.end())
            names.push_back(*name);
    };
    std::ranges::for_each(hosts, add);
    std::ranges::for_each(ipv4Addresses(), add);
    return names;
}

Result<TlsFiles> ownFiles(const std::filesystem::path& folder,
                          const std::vector<std::string>& hosts) {
    return ownTlsFiles(folder / ".usdlive" / "tls", certifiedNames(hosts));
}

}  // namespace

Result<std::unique_ptr<ServerTls>> loadTls(const ServerOptions& options,
                                           std::vector<std::string> hosts) {
    if (options.tls.empty()) return nullptr;
    hosts.emplace_back("localhost");  // always allowed (HO1)
    if (options.tls.front() != kOwnCertificate)
        return ServerTls::load({options.tls.front(), options.tls.back()}, hosts);
    const auto& folder =
        options.projectsFolder.empty() ? options.folders.front() : options.projectsFolder;
    const auto files = ownFiles(folder, hosts);
    if (!files) return tl::unexpected(files.error());
    return ServerTls::load(*files, hosts);
}

Result<std::string> ownFingerprint(const std::filesystem::path& folder, const std::string& host) {
    std::vector<std::string> hosts = namesOfThisMachine(false);
    hosts.push_back(host);
    const auto files = ownFiles(folder, hosts);
    if (!files) return tl::unexpected(files.error());
    return ServerTls::load(*files, {"*"}).map([](const auto& tls) { return tls->fingerprint(); });
}

}  // namespace usdlive::server
