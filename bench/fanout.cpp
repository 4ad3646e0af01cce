// Measures the server's cost, and the latency, of sending small edits to N clients.
//
//   --transport=websocket|dds
//   --clients=2,10,50,200  --edits=1,16  --seconds=5  --flush-interval=0  --durability=sync|os
//   --plain: without compact frames
//
// 4 writers make 60 transactions a second each. The server runs on its own core. The ceiling for
// WebSockets is a bare Beast broadcaster. It sends the same number of bytes to the same number of
// clients, one frame for each transaction, and stores nothing. The durable ceiling appends each
// message to a file and syncs it first, which is the minimum cost of an acknowledgement. The
// ceiling for DDS is Cyclone's ddsperf with the same number of readers.
#include "support/Fanout.h"

#include <stdexcept>

#include "support/Broadcaster.h"
#include "support/Figures.h"
#include "support/LiveClient.h"

using namespace usdlive::bench;

int main(int argc, char** argv) {
    if (isBroadcaster(argc, argv)) return runBroadcaster(argc, argv);
    return runBench("fanout", [&] {
        if (isJoin(argc, argv)) return runJoin(argv);
        Arguments arguments(argc, argv);
        FanoutConfiguration configuration;
        configuration.transport = arguments.text("--transport", configuration.transport);
        const bool dds = configuration.transport == "dds";
        if (!dds && configuration.transport != "websocket")
            throw std::runtime_error("--transport must be websocket or dds");
        const auto clients = arguments.numbers(
            "--clients", dds ? std::vector{2, 10, 50} : std::vector{2, 10, 50, 200});
        const auto edits = arguments.numbers("--edits", {1});
        const auto intervals = arguments.numbers("--flush-interval", {0});
        configuration.seconds = arguments.number("--seconds", 5);
        configuration.durability = arguments.text("--durability", "sync");
        configuration.compact = !arguments.flag("--plain");
        arguments.finish();
        for (const int interval : intervals)
            for (const int edit : edits)
                for (const int client : clients) {
                    configuration.flushIntervalMs = interval;
                    configuration.edits = edit;
                    configuration.clients = client;
                    measureFanout("fanout", configuration);
                }
    });
}
