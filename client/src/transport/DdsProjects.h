#pragma once

#include <map>
#include <optional>
#include <string>

#include "usdlive/client/transport/Connection.h"
#include "usdlive/common/dds/Topics.h"

namespace usdlive::client {

/// The projects that are served in a domain, as far as they have been heard of (DD1).
class DdsProjects {
public:
    explicit DdsProjects(const dds::Domain& domain) : reader_(domain, "") {}

    [[nodiscard]] dds_entity_t reader() const { return reader_.get(); }
    /// Takes what has come.
    void update();
    /// The server of the project that was started last, and speaks our protocol.
    [[nodiscard]] std::optional<std::uint64_t> serverOf(const std::string& project) const;
    /// Who speaks for the server; zeros: it is not heard of.
    [[nodiscard]] dds::ParticipantId participantOf(std::uint64_t server) const;
    [[nodiscard]] bool isAlive(std::uint64_t server) const { return servers_.contains(server); }
    [[nodiscard]] std::vector<DdsProject> all() const;

private:
    struct Served {
        DdsProject project;
        std::uint64_t started = 0;
        std::uint32_t protocol = 0;
        dds::ParticipantId participant{};
    };

    dds::Reader<dds::ProjectSample> reader_;
    std::map<std::uint64_t, Served> servers_;
};

}  // namespace usdlive::client
