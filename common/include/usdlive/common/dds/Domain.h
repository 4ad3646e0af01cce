// Joins a DDS domain on one network interface.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "usdlive/common/core/Result.h"

namespace usdlive::dds {

/// The DDS domain and network interface to use. Nothing is sent on any other interface.
struct DomainSettings {
    std::string interface = "lo";
    std::uint32_t domain = 74;  ///< at most kMaxDomain; the ports start at 7400 + 250 * domain
    /// A configuration file for Cyclone DDS. It replaces the generated one and has to name the
    /// interface.
    std::string configFile;
    /// A folder with this participant's identity and the authorities that it trusts
    /// (kSecurityFiles). Empty: all participants on the interface are trusted.
    std::string securityFolder;
};
inline constexpr std::uint32_t kMaxDomain = 230;

/// The files of DDS Security 1.1: the authority of identities, this participant's certificate and
/// key, the authority of permissions, and two documents that it has signed.
inline constexpr std::array<const char*, 6> kSecurityFiles{"identity_ca.pem", "identity.pem",
                                                           "identity.key",    "permissions_ca.pem",
                                                           "governance.p7s",  "permissions.p7s"};

/// Returns the common name of the certificate in the security folder; empty if there is none.
[[nodiscard]] std::string identityOf(const DomainSettings& settings);

/// Receives the messages of Cyclone DDS. Called from any thread.
using DomainLog = std::function<void(bool isError, std::string_view message)>;
/// Sets the log for the process, because Cyclone DDS has only one. Without a log its messages are
/// dropped.
void setDomainLog(DomainLog log);

/// Returns the IPv4 addresses of the network interfaces that the settings name, as text, with the
/// numbers of the interfaces; empty if there are none.
[[nodiscard]] std::string addressesOf(const DomainSettings& settings);

/// A participant in a DDS domain, with the threads that Cyclone DDS runs for it. Participants in
/// the same process also communicate over the interface.
class Domain {
public:
    virtual ~Domain() = default;
    /// Returns the dds_entity_t of the participant.
    [[nodiscard]] virtual std::int32_t participant() const = 0;
    /// Returns the common name of this participant's certificate; empty without DDS Security, or if
    /// a configuration file sets it up.
    [[nodiscard]] virtual const std::string& identity() const = 0;
};

/// Error: InvalidConfiguration names the setting that Cyclone DDS does not accept.
[[nodiscard]] Result<std::unique_ptr<Domain>> createDomain(const DomainSettings& settings);

}  // namespace usdlive::dds
