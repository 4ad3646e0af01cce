// Publishes layer states and presences to all clients over DDS.
#pragma once

#include <map>
#include <set>

#include "usdlive/common/dds/SegmentSender.h"  // TimePoint
#include "usdlive/common/dds/StateSamples.h"

namespace usdlive::server {

/// Sends layer states (DD11) and presences (DD12) once for all clients. Network thread.
class DdsStatePublisher {
public:
    DdsStatePublisher(const dds::Domain& domain, std::uint64_t server);

    void publish(const LayerStates& states, Revision afterCommit);
    void publish(const Presences& presences, dds::TimePoint now);
    /// Returns the number of the next sample.
    [[nodiscard]] std::uint64_t next() const { return last_ + 1; }
    /// Sends samples again that may have been lost. Call it a few times a second.
    void repeat(dds::TimePoint now);
    /// Forgets all states. Call it when the project is loaded again.
    void clear();

private:
    struct Person {
        Presence presence;
        std::uint64_t number = 0;
        dds::TimePoint leftAt{};  ///< zero: still present
        [[nodiscard]] bool hasLeft() const { return leftAt != dds::TimePoint{}; }
    };

    void write(const Person& person);

    const std::uint64_t server_;
    dds::Writer<dds::LayerStateSample> states_;
    dds::Writer<dds::PresenceSample> presences_;
    std::uint64_t last_ = 0;
    std::set<LayerId> layers_;           ///< layers with a published state
    std::map<ClientId, Person> people_;  ///< people who are present or left a moment ago
    dds::TimePoint repeated_{};
};

}  // namespace usdlive::server
