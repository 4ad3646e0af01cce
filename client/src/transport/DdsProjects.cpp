// Finds the projects that are served over DDS.
#include "transport/DdsProjects.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <tuple>

namespace usdlive::client {

namespace {

using std::chrono::steady_clock;

// The limit for servers; further ones are ignored.
constexpr std::size_t kMostServers = 10'000;

std::string fromEnvironment(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

}  // namespace

void DdsProjects::update() {
    reader_.take([this](const dds::ProjectSample& sample, const dds::SampleInfo& info) {
        // The number of a server belongs to its participant until the server has ended (DD13).
        const auto known = servers_.find(sample.server);
        if (known != servers_.end() && !info.isOf(known->second.participant)) return;
        if (!info.alive)
            servers_.erase(sample.server);
        else if (known != servers_.end() || servers_.size() < kMostServers)
            servers_[sample.server] = {{sample.name, sample.url, sample.revision, {sample.store}},
                                       sample.started,
                                       sample.protocol,
                                       info.participant};
    });
}

std::string DdsProjects::urlOf(std::uint64_t server) const {
    const auto known = servers_.find(server);
    return known == servers_.end() ? std::string() : known->second.project.url;
}

dds::ParticipantId DdsProjects::participantOf(std::uint64_t server) const {
    const auto known = servers_.find(server);
    return known == servers_.end() ? dds::ParticipantId{} : known->second.participant;
}

std::optional<std::uint64_t> DdsProjects::serverOf(const std::string& project,
                                                   const StoreId& preferred) const {
    const auto rank = [&](std::uint64_t server) {
        const Served& served = servers_.at(server);
        return std::pair(served.project.store == preferred, served.started);
    };
    std::optional<std::uint64_t> best;
    for (const auto& [server, served] : servers_)
        if (served.project.name == project && served.protocol == dds::kDdsProtocol &&
            (!best || rank(*best) < rank(server)))
            best = server;
    return best;
}

std::vector<DdsProject> DdsProjects::all() const {
    std::vector<DdsProject> projects;
    for (const auto& [server, served] : servers_) projects.push_back(served.project);
    std::sort(projects.begin(), projects.end(), [](const auto& left, const auto& right) {
        return std::tie(left.name, left.url) < std::tie(right.name, right.url);
    });
    return projects;
}

Result<dds::DomainSettings> ddsSettings() {
    dds::DomainSettings settings;
    if (auto interface = fromEnvironment("USDLIVE_DDS_INTERFACE"); !interface.empty())
        settings.interface = std::move(interface);
    settings.configFile = fromEnvironment("USDLIVE_DDS_CONFIG");
    settings.securityFolder = fromEnvironment("USDLIVE_DDS_SECURITY");
    if (const auto text = fromEnvironment("USDLIVE_DDS_DOMAIN"); !text.empty()) {
        const char* last = text.data() + text.size();
        const auto [end, error] = std::from_chars(text.data(), last, settings.domain);
        if (error != std::errc{} || end != last)
            return fail(ErrorCode::InvalidConfiguration,
                        "USDLIVE_DDS_DOMAIN is '" + text + "', which is not a number");
    }
    return settings;
}

std::string ddsIdentity(const dds::DomainSettings& settings) { return dds::identityOf(settings); }

Result<std::vector<DdsProject>> listDdsProjects(const dds::DomainSettings& settings,
                                                std::chrono::milliseconds time) {
    const auto domain = dds::createDomain(settings);
    if (!domain) return tl::unexpected(domain.error());
    DdsProjects projects(**domain);
    dds::WaitSet waitSet(**domain);
    waitSet.attach(projects.reader());
    const auto end = steady_clock::now() + time;
    for (auto now = steady_clock::now(); now < end; now = steady_clock::now()) {
        waitSet.wait(end - now);
        projects.update();
    }
    return projects.all();
}

}  // namespace usdlive::client
