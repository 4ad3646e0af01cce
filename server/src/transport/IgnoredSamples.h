// Counts the DDS samples that were ignored.
#pragma once

#include <array>
#include <cstdint>
#include <set>
#include <string_view>

namespace usdlive::server {

/// The reasons for ignoring a sample received over DDS (DD13).
enum class IgnoreReason {
    NotGreeted,     ///< its participant has never opened a session
    OtherClient,    ///< it names a client of another participant
    OtherProtocol,  ///< it has another protocol version
    Malformed,      ///< too large, or not allowed in its stream
    TooMany         ///< its participant sends or connects faster than a client may
};
inline constexpr std::size_t kIgnoreReasons = 5;
/// Returns the name for logs and metrics.
[[nodiscard]] std::string_view nameOf(IgnoreReason reason);
using IgnoreCounts = std::array<std::uint64_t, kIgnoreReasons>;

/// Counts ignored samples and detects the first one of each participant. A plain value.
class IgnoredSamples {
public:
    using Participant = std::array<std::uint8_t, 16>;  ///< its GUID

    /// With more participants than this, add() may return true twice for one of them.
    static constexpr std::size_t kMostParticipants = 1'024;

    /// Returns true for the first ignored sample of this participant.
    bool add(IgnoreReason reason, const Participant& participant, std::uint64_t samples = 1);
    [[nodiscard]] const IgnoreCounts& counts() const { return counts_; }

private:
    IgnoreCounts counts_{};
    std::set<Participant> participants_;
};

}  // namespace usdlive::server
