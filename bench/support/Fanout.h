// Measures the delivery of edits to many clients.
#pragma once

#include <string>

namespace usdlive::bench {

/// The configuration of `fanout` and `saturate`.
struct FanoutConfiguration {
    int clients = 0;
    int edits = 1;
    int fields = 1000;
    int window = 0;  ///< 0: 60 transactions a second for each writer
    double seconds = 5;
    int flushIntervalMs = 0;
    std::string durability = "sync";
    std::string transport = "websocket";  ///< or "tls", or "dds", on loopback
    /// Access rules: "none", "others" (20 that do not concern the writers) or "own" (20 that do,
    /// for other prims than those that they edit).
    std::string rules = "none";
    bool compact = true;  ///< with compact frames (FR9); not over DDS
};
/// Measures the real server, then its ceiling, and prints both as one JSON line.
void measureFanout(const char* name, const FanoutConfiguration& configuration);

}  // namespace usdlive::bench
