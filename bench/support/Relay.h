// Counts the bytes of a connection, for benchmarks.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

namespace usdlive::bench {

/// Passes one connection of a client on to a server on this machine, and counts the bytes in both
/// directions, as they are on the sockets: HTTP, WebSocket and frames.
class Relay {
public:
    /// Throws if it cannot listen.
    explicit Relay(std::uint16_t serverPort);
    /// Ends the connection.
    ~Relay();
    Relay(const Relay&) = delete;
    Relay& operator=(const Relay&) = delete;

    [[nodiscard]] std::string url() const;
    [[nodiscard]] std::uint64_t bytesUp() const { return up_; }
    [[nodiscard]] std::uint64_t bytesDown() const { return down_; }

private:
    void run(std::uint16_t serverPort);

    int listener_ = -1;
    std::uint16_t port_ = 0;
    std::atomic<std::uint64_t> up_ = 0, down_ = 0;
    std::atomic<bool> ends_ = false;
    std::thread thread_;
};

}  // namespace usdlive::bench
