// One run of the simulation.
#pragma once

#include <cstdint>
#include <string>

namespace usdlive::simulation {

/// The counters of one run, for the report.
struct SimReport {
    std::uint64_t commits = 0, lost = 0, restarts = 0, snapshots = 0;
    std::uint64_t unloads = 0;      ///< unloaded layers since the last start
    std::uint64_t accepted = 0;     ///< commits of which the author received an acceptance (FR11)
    std::uint64_t together = 0;     ///< commits that a client received as part of a later one (CF1)
    std::uint64_t compactions = 0;  ///< compactions of the history
    std::uint64_t previewedBlobs = 0;  ///< big values that arrived for a preview
    std::uint64_t collected = 0;       ///< big values that nothing named (B6)
    std::uint64_t forgotten = 0;       ///< forgotten clients (M14)
    std::uint64_t inParts = 0;         ///< commits in parts (FR8)
    std::uint64_t writtenAgain = 0;    ///< edits that were replaced before they were sent (SE15)
    std::uint64_t moves = 0;           ///< namespace edits
    std::uint64_t movesOfSeveral = 0;  ///< those in the end in several layers
    std::uint64_t refusedMoves = 0;
    std::uint64_t writes = 0;          ///< to prims that namespace edits may move
    std::uint64_t carried = 0;         ///< writes that are in the end at another path (M3)
    std::uint64_t otherHistories = 0;  ///< other projects and restored copies at the address (ID2)
    std::uint64_t joinsOfOther = 0;    ///< decisions to join one (ID4)
    std::uint64_t regained = 0;        ///< edits that it lacked
    std::uint64_t policies = 0;        ///< changes of what users may do (AC4, AC6)
    std::uint64_t forbidden = 0;       ///< transactions that were refused because of them
    std::uint64_t undos = 0, redos = 0;
    std::uint64_t kept = 0;          ///< registers that undos have left because others wrote them
    std::uint64_t undosChecked = 0;  ///< those compared with what others have written
    std::uint64_t reverted = 0;      ///< edits that take work of the log back, in the end
    std::uint64_t stayed = 0;        ///< registers and specs that such a revert has left
    std::string failure;             ///< empty: everything holds
};

/// Runs one seed: 2 to 8 editors and a server with faults, then a time without faults and edits,
/// and a comparison.
SimReport play(std::uint64_t seed);

}  // namespace usdlive::simulation
