#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace usdlive::bench {

/// What a message of the broadcaster begins with, both ways; the rest of it is padding. The length
/// is that of what follows it, as in FR1.
struct [[gnu::packed]] RelayHead {
    std::uint32_t length;
    std::uint32_t writer;
    std::uint64_t sequence;
};

/// The ceiling: a server of bare Beast that sends each message it gets on to everybody, as
/// `frameBytes` bytes. It knows no layers.
struct BroadcasterOptions {
    std::filesystem::path portFile;
    std::size_t frameBytes = 0;
    /// What one turn of the event loop brought leaves as one message; otherwise one for each frame.
    bool joins = false;
    /// Each message is appended to this file and synced before anybody gets it, on the same thread;
    /// empty: it knows no disk.
    std::filesystem::path log;
};
/// Its command line: this program again; main() hands it over when `isBroadcaster`.
[[nodiscard]] std::vector<std::string> broadcasterCommand(const BroadcasterOptions& options);
[[nodiscard]] bool isBroadcaster(int argc, char** argv);
/// Until it is killed.
int runBroadcaster(int argc, char** argv);

}  // namespace usdlive::bench
