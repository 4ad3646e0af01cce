// Finds the projects that servers announce over DDS.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "transport/Connection.h"
#include "usdlive/common/dds/Topics.h"

namespace usdlive::client {

/// The projects announced in a domain (DD1).
class DdsProjects {
public:
    explicit DdsProjects(const dds::Domain& domain) : reader_(domain, "") {}

    [[nodiscard]] dds_entity_t reader() const { return reader_.get(); }
    /// Processes received announcements.
    void update();
    /// Returns the server of the project that has our protocol version: one with this store, if
    /// there is one (ID1), and of several the one that started last.
    [[nodiscard]] std::optional<std::uint64_t> serverOf(const std::string& project,
                                                        const StoreId& preferred) const;
    /// Returns the WebSocket address of the project, or an empty text.
    [[nodiscard]] std::string urlOf(std::uint64_t server) const;
    /// Returns the participant of the server, or zeros if the server is unknown.
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
