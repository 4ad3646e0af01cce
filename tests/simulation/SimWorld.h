#pragma once

#include <cstdint>
#include <string>

namespace usdlive::simulation {

/// What happened in one run, for the report.
struct SimReport {
    std::uint64_t commits = 0, lost = 0, restarts = 0, snapshots = 0;
    std::uint64_t unloads = 0;         ///< of layers, since the last start
    std::uint64_t together = 0;        ///< commits that reached somebody within a later one (CF1)
    std::uint64_t compactions = 0;     ///< of the history
    std::uint64_t previewedBlobs = 0;  ///< big values that came for a preview
    std::uint64_t collected = 0;       ///< big values that nothing named (B6)
    std::uint64_t forgotten = 0;       ///< clients (M14)
    std::uint64_t inParts = 0;         ///< commits in parts (FR8)
    std::uint64_t writtenAgain = 0;    ///< edits that were written again before they were sent
    std::string failure;               ///< empty: everything holds
};

/// Plays one seed: 2 to 8 editors and a server, faults, and at the end silence and a comparison.
SimReport play(std::uint64_t seed);

}  // namespace usdlive::simulation
