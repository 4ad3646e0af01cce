// An editor in 30 lines: minimal ws://127.0.0.1:7447 shot.usda ada
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>
#include <usdlive/client/usd/Client.h>

#include <chrono>
#include <iostream>
#include <thread>

int main(int argc, char** argv) {
    if (argc != 4) return std::cerr << "minimal URL LAYER USER\n", 2;
    auto client = usdlive::Client::connect(argv[1], {.user = argv[3], .application = "minimal"});
    if (!client) return std::cerr << client.error().message << "\n", 1;
    usdlive::Client& live = **client;
    live.setEventHandler([](const usdlive::client::Event& event) {  // called by tick()
        if (const auto* lost = std::get_if<usdlive::client::event::Lost>(&event))
            std::cerr << "not in the project: " << lost->work.reason.message << "\n";
    });
    const auto layer = live.openLayer({argv[2]});  // an ordinary SdfLayer
    if (!layer) return std::cerr << layer.error().message << "\n", 1;
    const pxr::SdfPath path("/" + std::string(argv[3]));
    pxr::SdfCreatePrimInLayer(*layer, path);
    for (int frame = 0; frame < 120; ++frame) {
        (*layer)->SetField(path, pxr::SdfFieldKeys->Comment, "frame " + std::to_string(frame));
        live.showPresence({.selection = {path.GetString()}});
        live.tick(4.0);  // sends own edits, and applies those of others
        std::this_thread::sleep_for(std::chrono::milliseconds(16));
    }
    return live.leave() ? 1 : 0;  // waits until the edits are committed
}
