// Creates participants of Cyclone DDS, with a generated configuration or one from a file.
#include "usdlive/common/dds/Domain.h"

#include <arpa/inet.h>
#include <dds/dds.h>
#include <dds/ddsrt/log.h>
#include <ifaddrs.h>
#include <net/if.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <sstream>

#include "SecurityConfig.h"
#include "usdlive/common/dds/DomainConfig.h"

namespace usdlive::dds {

namespace {

// --- Messages of Cyclone DDS

struct LogState {
    std::mutex mutex;
    DomainLog log;
    std::string* capture = nullptr;  ///< collects the errors while a domain is created
};

LogState& logState() {
    static LogState state;
    return state;
}

std::string oneLine(std::string_view message) {
    std::string line(message);
    std::replace(line.begin(), line.end(), '\n', ' ');
    return line;
}

void onLog(void*, const dds_log_data_t* data) {
    LogState& state = logState();
    const std::lock_guard lock(state.mutex);
    const std::string_view message(data->message, data->size);
    const bool isError = (data->priority & (DDS_LC_ERROR | DDS_LC_FATAL)) != 0;
    if (state.capture) {
        if (isError) *state.capture += (state.capture->empty() ? "" : "; ") + oneLine(message);
    } else if (state.log) {
        state.log(isError, message);
    }
}

/// Collects errors while it lives; one at a time.
class Capture {
public:
    Capture() {
        dds_set_log_sink(onLog, nullptr);
        const std::lock_guard lock(logState().mutex);
        logState().capture = &errors_;
    }
    ~Capture() {
        const std::lock_guard lock(logState().mutex);
        logState().capture = nullptr;
    }
    [[nodiscard]] const std::string& errors() const { return errors_; }

private:
    std::string errors_;
};

// --- The configuration

struct Interface {
    bool exists = false, isLoopback = false;
    std::string others;
};

Interface findInterface(const std::string& name) {
    Interface found;
    ifaddrs* list = nullptr;
    if (::getifaddrs(&list) != 0) return found;
    std::set<std::string> others;
    for (const ifaddrs* entry = list; entry; entry = entry->ifa_next) {
        others.insert(entry->ifa_name);
        if (name != entry->ifa_name) continue;
        found.exists = true;
        found.isLoopback = (entry->ifa_flags & IFF_LOOPBACK) != 0;
    }
    ::freeifaddrs(list);
    for (const std::string& other : others)
        found.others += (found.others.empty() ? "" : ", ") + other;
    return found;
}

std::string textOf(const in_addr& address) {
    char text[INET_ADDRSTRLEN] = {};
    return ::inet_ntop(AF_INET, &address, text, sizeof text) ? text : "";
}

bool isPlain(const std::string& name) {
    return !name.empty() && name.find_first_not_of(
                                "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                "0123456789._:@-") == std::string::npos;
}

/// Repairs losses fast, because Cyclone DDS waits 100 ms by default before it requests missing
/// samples. A writer closes without waiting for readers that do not respond. There is one receiving
/// thread: Cyclone DDS ends several with packets to its own address, and waits for ever when the
/// interface does not have that address any more. The loopback interface has no MULTICAST flag but
/// supports it, and takes large packets.
Result<std::string> ownConfig(const DomainSettings& settings) {
    const Interface found = findInterface(settings.interface);
    if (!isPlain(settings.interface) || !found.exists)
        return fail(ErrorCode::InvalidConfiguration, "DDS: there is no network interface '" +
                                                         settings.interface +
                                                         "'. Use one of: " + found.others);
    std::string security;
    if (!settings.securityFolder.empty()) {
        auto made = securityConfig(settings.securityFolder);
        if (!made) return made;
        security = std::move(*made);
    }
    std::ostringstream xml;
    xml << R"(<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name=")"
        << settings.interface << '"' << (found.isLoopback ? R"( multicast="true")" : "")
        << "/></Interfaces>"
        << (found.isLoopback ? "<MaxMessageSize>65500B</MaxMessageSize>"
                               "<FragmentSize>65000B</FragmentSize>"
                             : "")
        << "</General><Discovery><ExternalDomainId>" << settings.domain
        << "</ExternalDomainId><SPDPInterval>500 ms</SPDPInterval>"
           "<LeaseDuration>5 s</LeaseDuration></Discovery>"
           "<Internal><NackDelay>10 ms</NackDelay><WriterLingerDuration>0 s</WriterLingerDuration>"
           R"(<HeartbeatInterval min="5 ms" minsched="20 ms" max="1 s">50 ms</HeartbeatInterval>)"
           "<MultipleReceiveThreads>false</MultipleReceiveThreads>"
           "</Internal>"
        << security << "</Domain></CycloneDDS>";
    return xml.str();
}

/// Cyclone DDS accepts truncated XML and uses defaults for the missing rest, which means the
/// machine's default network. So this checks that the file is complete.
Result<std::string> configOf(const std::string& path) {
    const auto wrong = [&](const std::string& what) {
        return fail(ErrorCode::InvalidConfiguration, "DDS: " + path + " " + what);
    };
    std::ifstream file(path);
    if (!file) return wrong("cannot be read");
    std::string text(std::istreambuf_iterator<char>(file), {});
    constexpr const char* kSpace = " \t\r\n";
    text.erase(0, std::min(text.find_first_not_of(kSpace), text.size()));
    text.erase(text.find_last_not_of(kSpace) + 1);
    if (!text.starts_with("<") || !text.ends_with("</CycloneDDS>"))
        return wrong("is not a configuration of Cyclone DDS: it must end with </CycloneDDS>");
    if (text.find("<NetworkInterface") == std::string::npos)
        return wrong("does not name a NetworkInterface to use");
    return text;
}

// --- The domain

// Domains are created, found and deleted one at a time.
std::mutex& domainsMutex() {
    static std::mutex mutex;
    return mutex;
}

/// A domain of Cyclone DDS. A process has at most one for each number.
class CycloneDomain {
public:
    CycloneDomain(dds_entity_t domain, std::string config)
        : domain_(domain), config_(std::move(config)) {}
    ~CycloneDomain() {
        const std::lock_guard lock(domainsMutex());
        dds_delete(domain_);
    }
    [[nodiscard]] const std::string& config() const { return config_; }

private:
    const dds_entity_t domain_;
    const std::string config_;
};

class Participant final : public Domain {
public:
    Participant(std::shared_ptr<CycloneDomain> domain, dds_entity_t participant,
                std::string identity)
        : domain_(std::move(domain)), participant_(participant), identity_(std::move(identity)) {}
    ~Participant() override { dds_delete(participant_); }
    std::int32_t participant() const override { return participant_; }
    const std::string& identity() const override { return identity_; }

private:
    const std::shared_ptr<CycloneDomain> domain_;
    const dds_entity_t participant_;
    const std::string identity_;
};

/// Returns a domain number that only this process uses. Each domain object has its own one, apart
/// from those of a host application, and ExternalDomainId tells other processes the real one. A
/// configuration file or permissions name the real number, which all objects of the process then
/// share.
dds_domainid_t localId(const DomainSettings& settings) {
    static std::atomic<dds_domainid_t> last{0x75736400};
    const bool isNamed = !settings.configFile.empty() || !settings.securityFolder.empty();
    return isNamed ? settings.domain : ++last;
}

/// Returns the existing domain with this number. The caller holds the mutex.
std::weak_ptr<CycloneDomain>& domainOf(dds_domainid_t id) {
    static std::map<dds_domainid_t, std::weak_ptr<CycloneDomain>> domains;
    std::erase_if(domains,
                  [id](const auto& entry) { return entry.first != id && entry.second.expired(); });
    return domains[id];
}

}  // namespace

void setDomainLog(DomainLog log) {
    dds_set_log_sink(onLog, nullptr);
    const std::lock_guard lock(logState().mutex);
    logState().log = std::move(log);
}

std::string addressesOf(const DomainSettings& settings) {
    const auto file =
        settings.configFile.empty() ? Result<std::string>("") : configOf(settings.configFile);
    const auto isUsed = [&](const std::string& name) {
        return settings.configFile.empty() ? name == settings.interface : file && file->find('"' + name + '"') != file->npos;
    };
    ifaddrs* list = nullptr;
    if (::getifaddrs(&list) != 0) return {};
    std::set<std::string> found;
    for (const ifaddrs* entry = list; entry; entry = entry->ifa_next) {
        if (!entry->ifa_addr || entry->ifa_addr->sa_family != AF_INET || !isUsed(entry->ifa_name))
            continue;
        const auto& address = reinterpret_cast<const sockaddr_in&>(*entry->ifa_addr);
        found.insert(textOf(address.sin_addr) + " (" + entry->ifa_name + ", interface " +
                     std::to_string(::if_nametoindex(entry->ifa_name)) + ")");
    }
    ::freeifaddrs(list);
    std::string text;
    for (const std::string& one : found) text += (text.empty() ? "" : ", ") + one;
    return text;
}

Result<std::string> cycloneConfig(const DomainSettings& settings) {
    if (settings.configFile.empty()) return ownConfig(settings);
    if (!settings.securityFolder.empty())
        return fail(ErrorCode::InvalidConfiguration,
                    "DDS: use either a configuration file or a security folder. A configuration "
                    "file has to contain the security settings");
    return configOf(settings.configFile);
}

Result<std::unique_ptr<Domain>> createDomain(const DomainSettings& settings) {
    if (settings.domain > kMaxDomain)
        return fail(ErrorCode::InvalidConfiguration,
                    "DDS: the domain must be a number up to " + std::to_string(kMaxDomain));
    const bool own = settings.configFile.empty();
    const auto config = cycloneConfig(settings);
    if (!config) return tl::unexpected(config.error());

    std::shared_ptr<CycloneDomain> domain;  // released after the mutex is unlocked
    const std::lock_guard lock(domainsMutex());
    const Capture said;
    const auto failed = [&](const std::string& what, const std::string& why) {
        const std::string& secured = settings.securityFolder;
        return fail(ErrorCode::InvalidConfiguration,
                    "DDS: " + what + " " + (own ? settings.interface : settings.configFile) +
                        (secured.empty() ? "" : " with " + secured) + ": " +
                        (said.errors().empty() ? why : said.errors()));
    };
    const dds_domainid_t id = localId(settings);
    domain = domainOf(id).lock();
    if (domain && domain->config() != *config)
        return failed("cannot use",
                      "this process uses the domain already with another configuration");
    if (!domain) {
        const dds_entity_t made = dds_create_domain(id, config->c_str());
        // Continuing would create a domain with the defaults of Cyclone DDS, which means the
        // machine's default network.
        if (made < 0) return failed("cannot use", dds_strretcode(-made));
        domain = std::make_shared<CycloneDomain>(made, *config);
        domainOf(id) = domain;
    }
    const dds_entity_t participant = dds_create_participant(id, nullptr, nullptr);
    if (participant < 0) return failed("no participant on", dds_strretcode(-participant));
    return std::make_unique<Participant>(std::move(domain), participant, identityOf(settings));
}

}  // namespace usdlive::dds
