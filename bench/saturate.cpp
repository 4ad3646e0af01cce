// Measures how many edits a second the server can order, store and send to 10 clients.
//
//   --durability=sync,os  --fields=1000,100000,1000000  --edits=1  --window=256  --clients=10
//   --seconds=5  --transport=websocket,tls
//   --plain: without compact frames
//   --rules=none,others,own: with access rules, see FanoutConfiguration
//
// 4 writers write as fast as they are acknowledged, each with `window` unacknowledged transactions.
// The ceiling is a bare Beast relay, which joins the messages of one turn of its event loop and
// stores nothing.
#include <sstream>
#include <string>

#include "support/Broadcaster.h"
#include "support/Fanout.h"
#include "support/Figures.h"
#include "support/LiveClient.h"

using namespace usdlive::bench;

int main(int argc, char** argv) {
    if (isBroadcaster(argc, argv)) return runBroadcaster(argc, argv);
    return runBench("saturate", [&] {
        if (isJoin(argc, argv)) return runJoin(argv);
        Arguments arguments(argc, argv);
        std::istringstream durabilities(arguments.text("--durability", "sync,os"));
        const auto transports = arguments.text("--transport", "websocket");
        const auto rules = arguments.text("--rules", "none");
        const auto fields = arguments.numbers("--fields", {1000});
        FanoutConfiguration configuration;
        configuration.clients = arguments.number("--clients", 10);
        configuration.edits = arguments.number("--edits", 1);
        configuration.window = arguments.number("--window", 256);
        configuration.seconds = arguments.number("--seconds", 5);
        configuration.compact = !arguments.flag("--plain");
        arguments.finish();
        while (std::getline(durabilities, configuration.durability, ','))
            for (const int count : fields) {
                configuration.fields = count;
                std::istringstream each(transports);
                while (std::getline(each, configuration.transport, ',')) {
                    std::istringstream all(rules);
                    while (std::getline(all, configuration.rules, ','))
                        measureFanout("saturate", configuration);
                }
            }
    });
}
