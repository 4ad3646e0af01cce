// A minimal server that sends each message to all connections, to compare with.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace usdlive::bench {

/// The head of each message to and from the broadcaster; the rest of a message is padding. The
/// length counts the bytes after it, as in FR1.
struct [[gnu::packed]] RelayHead {
    std::uint32_t length;
    std::uint32_t writer;
    std::uint64_t sequence;
};

/// The ceiling: a bare Beast server that sends each message that it receives to all clients, as
/// `frameBytes` bytes. It knows no layers.
struct BroadcasterOptions {
    std::filesystem::path portFile;
    std::size_t frameBytes = 0;
    /// Sends everything from one turn of the event loop as one message; otherwise one message for
    /// each frame.
    bool joins = false;
    /// The file to which each message is appended, and synced before it is sent, on the same
    /// thread. Empty: no disk.
    std::filesystem::path log;
};
/// The broadcaster's command line: this program again. main() calls runBroadcaster() when
/// `isBroadcaster` returns true.
[[nodiscard]] std::vector<std::string> broadcasterCommand(const BroadcasterOptions& options);
[[nodiscard]] bool isBroadcaster(int argc, char** argv);
/// Runs until the process is killed.
int runBroadcaster(int argc, char** argv);

}  // namespace usdlive::bench
