// Counts the DDS samples that the server ignores.
#include "usdlive/server/transport/OddSamples.h"

namespace usdlive::server {

std::string_view nameOf(Oddity oddity) {
    constexpr std::array<std::string_view, kOddities> kNames{"notGreeted", "otherClient",
                                                             "otherProtocol", "malformed"};
    return kNames.at(std::size_t(oddity));
}

bool OddSamples::add(Oddity oddity, const Participant& participant) {
    ++counts_.at(std::size_t(oddity));
    if (participants_.size() >= kMostParticipants && !participants_.contains(participant))
        participants_.clear();
    return participants_.insert(participant).second;
}

}  // namespace usdlive::server
