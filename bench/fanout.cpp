// What does it cost the server, and how long does it take, to bring small edits to N clients?
//
//   --transport=websocket|dds
//   --clients=2,10,50,200  --edits=1,16  --seconds=5  --flush-interval=0  --durability=sync|os
//
// 4 writers make 60 transactions a second each. The server has a core of its own. The ceiling of
// WebSockets is a bare Beast broadcaster that sends as many bytes to as many, a frame for each
// transaction, and stores nothing; the durable one appends each to a file and syncs it first, which
// is the least that an acknowledgement costs. That of DDS is Cyclone's ddsperf with as many
// readers.
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
            throw std::runtime_error("--transport is websocket or dds");
        const auto clients = arguments.numbers(
            "--clients", dds ? std::vector{2, 10, 50} : std::vector{2, 10, 50, 200});
        const auto edits = arguments.numbers("--edits", {1});
        const auto intervals = arguments.numbers("--flush-interval", {0});
        configuration.seconds = arguments.number("--seconds", 5);
        configuration.durability = arguments.text("--durability", "sync");
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
