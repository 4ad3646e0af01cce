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

/// Where DDS is spoken. Nothing is ever sent on another interface than this one.
struct DomainSettings {
    std::string interface = "lo";
    std::uint32_t domain = 74;  ///< at most kMaxDomain; the ports are 7400 + 250 * domain and on
    /// A configuration of Cyclone DDS instead of ours, which then says the interface.
    std::string configFile;
    /// A folder with what says who this participant is and whom it trusts (kSecurityFiles); empty:
    /// everybody on the interface is trusted.
    std::string securityFolder;
};
inline constexpr std::uint32_t kMaxDomain = 230;

/// Of DDS Security 1.1: the authority of identities and this participant's own one, with its key;
/// the authority of permissions, and what it has signed.
inline constexpr std::array<const char*, 6> kSecurityFiles{"identity_ca.pem", "identity.pem",
                                                           "identity.key",    "permissions_ca.pem",
                                                           "governance.p7s",  "permissions.p7s"};

/// What Cyclone has to say, from any thread.
using DomainLog = std::function<void(bool isError, std::string_view message)>;
/// One for the process, as Cyclone has it; without one its words are dropped.
void setDomainLog(DomainLog log);

/// A participant in a DDS domain, with the threads that Cyclone runs for it. Others in the same
/// process are reached over the interface, as any other.
class Domain {
public:
    virtual ~Domain() = default;
    /// dds_entity_t of the participant.
    [[nodiscard]] virtual std::int32_t participant() const = 0;
};

/// InvalidConfiguration says what Cyclone does not like of the settings.
[[nodiscard]] Result<std::unique_ptr<Domain>> createDomain(const DomainSettings& settings);

}  // namespace usdlive::dds
