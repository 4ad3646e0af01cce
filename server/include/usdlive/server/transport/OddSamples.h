#pragma once

#include <array>
#include <cstdint>
#include <set>
#include <string_view>

namespace usdlive::server {

/// Why a sample that came over DDS was ignored (DD13).
enum class Oddity {
    NotGreeted,     ///< its participant has never opened a session
    OtherClient,    ///< it speaks for a client of another participant
    OtherProtocol,  ///< it is of another version
    Malformed       ///< too large, or outside of what its stream may send
};
inline constexpr std::size_t kOddities = 4;
/// For logs and metrics.
[[nodiscard]] std::string_view nameOf(Oddity oddity);
using OddityCounts = std::array<std::uint64_t, kOddities>;

/// Counts odd samples, and says of which participant there was none before. A plain value.
class OddSamples {
public:
    using Participant = std::array<std::uint8_t, 16>;  ///< its GUID

    /// Of more than these it may be told twice that it was the first.
    static constexpr std::size_t kMostParticipants = 1'024;

    /// True: the first one of this participant.
    bool add(Oddity oddity, const Participant& participant);
    [[nodiscard]] const OddityCounts& counts() const { return counts_; }

private:
    OddityCounts counts_{};
    std::set<Participant> participants_;
};

}  // namespace usdlive::server
