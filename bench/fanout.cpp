// What does it cost the server, and how long does it take, to bring small edits to N clients?
//
//   --clients=2,10,50,200  --edits=1,16  --seconds=5  --flush-interval=0  --durability=sync|os
//
// 4 writers make 60 transactions a second each. The server has a core of its own. The ceiling is a
// bare Beast broadcaster that sends as many bytes to as many, a frame for each transaction, and
// stores nothing.
#include "support/Fanout.h"

#include "support/Broadcaster.h"
#include "support/Figures.h"

using namespace usdlive::bench;

int main(int argc, char** argv) {
    if (isBroadcaster(argc, argv)) return runBroadcaster(argc, argv);
    return runBench("fanout", [&] {
        Arguments arguments(argc, argv);
        const auto clients = arguments.numbers("--clients", {2, 10, 50, 200});
        const auto edits = arguments.numbers("--edits", {1});
        const auto intervals = arguments.numbers("--flush-interval", {0});
        FanoutConfiguration configuration;
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
