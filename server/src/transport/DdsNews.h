#pragma once

#include <map>
#include <set>

#include "usdlive/common/dds/NewsSamples.h"
#include "usdlive/common/dds/SegmentSender.h"  // TimePoint

namespace usdlive::server {

/// What a server tells once for all its clients: layer states (DD11) and presences (DD12). Network
/// thread.
class DdsNews {
public:
    DdsNews(const dds::Domain& domain, std::uint64_t server);

    void tell(const LayerStates& states, Revision afterCommit);
    void tell(const Presences& presences, dds::TimePoint now);
    /// The number of what is told next.
    [[nodiscard]] std::uint64_t next() const { return last_ + 1; }
    /// Says again what may have been lost; to be called a few times a second.
    void repeat(dds::TimePoint now);
    /// The project is made anew: nothing is known.
    void clear();

private:
    struct Person {
        Presence presence;
        std::uint64_t number = 0;
        dds::TimePoint gone{};  ///< since then, unless zero
        [[nodiscard]] bool isGone() const { return gone != dds::TimePoint{}; }
    };

    void write(const Person& person);

    const std::uint64_t server_;
    dds::Writer<dds::LayerStateSample> states_;
    dds::Writer<dds::PresenceSample> presences_;
    std::uint64_t last_ = 0;
    std::set<LayerId> layers_;           ///< of which a state was told
    std::map<ClientId, Person> people_;  ///< who is there, or has gone just now
    dds::TimePoint repeated_{};
};

}  // namespace usdlive::server
