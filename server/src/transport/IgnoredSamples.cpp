// Counts the DDS samples that the server ignores.
#include "transport/IgnoredSamples.h"

namespace usdlive::server {

std::string_view nameOf(IgnoreReason reason) {
    constexpr std::array<std::string_view, kIgnoreReasons> kNames{
        "notGreeted", "otherClient", "otherProtocol", "malformed", "tooMany"};
    return kNames.at(std::size_t(reason));
}

bool IgnoredSamples::add(IgnoreReason reason, const Participant& participant,
                         std::uint64_t samples) {
    counts_.at(std::size_t(reason)) += samples;
    if (participants_.size() >= kMostParticipants && !participants_.contains(participant))
        participants_.clear();
    return participants_.insert(participant).second;
}

}  // namespace usdlive::server
