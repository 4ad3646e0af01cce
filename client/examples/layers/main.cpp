// Edits the layers of a live stage with the layers API: auto authoring, a lock, events and a save.
//     layers ws://127.0.0.1:7447 shot.usda ada
#include <pxr/usd/sdf/primSpec.h>
#include <pxr/usd/sdf/schema.h>
#include <usdlive/client/usd/Client.h>
#include <usdlive/client/usd/layers/AutoAuthoring.h>
#include <usdlive/client/usd/layers/Layers.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <string>

#if __has_include(<pxr/usd/usd/stage.h>)
#include "UsdStageHost.h"
#else
#include <usdlive/client/usd/layers/ComposedStageHost.h>
#include <usdlive/client/usd/stage/Stage.h>
#endif

namespace layers = usdlive::layers;

// Writes the comment of /World into the edit target, as an editor's tool does.
void comment(layers::Layers& editor, const std::string& text) {
    const pxr::SdfPath world("/World");
    const auto target = editor.host().editTarget();
    pxr::SdfCreatePrimInLayer(target, world);
    target->SetField(world, pxr::SdfFieldKeys->Comment, text);
}

// Clears the documentation of /World. Clearing gives the edit target what the layers have.
void clearDocumentation(layers::Layers& editor) {
    const pxr::SdfPath world("/World");
    const layers::Clearing clearing(editor.autoAuthoring(), {world});
    editor.host().editTarget()->EraseField(world, pxr::SdfFieldKeys->Documentation);
}

void frame(usdlive::Client& live, layers::Layers& editor) {
    using Ms = std::chrono::duration<double, std::milli>;
    live.tick(4.0);  // sends own edits and applies those of others
    editor.update(Ms(std::chrono::steady_clock::now().time_since_epoch()).count());
    for (const layers::LayerEvent& event : editor.takeEvents()) {
        std::cout << layers::eventSuffix(event.type);
        for (const std::string& value : event.values) std::cout << " " << value;
        std::cout << "\n";
    }
}

int main(int argc, char** argv) {
    if (argc != 4) return std::cerr << "layers URL LAYER USER\n", 2;
    auto client = usdlive::Client::connect(argv[1], {.user = argv[3], .application = "layers"});
    if (!client) return std::cerr << client.error().message << "\n", 1;
    usdlive::Client& live = **client;
    live.setEventHandler([](const usdlive::client::Event& event) {
        if (const auto* failed = std::get_if<usdlive::client::event::JoinFailed>(&event))
            std::cerr << failed->layer.value << ": " << failed->reason.message << "\n";
    });
    const auto root = live.openLayer({argv[2]});
    if (!root) return std::cerr << root.error().message << "\n", 1;

#if __has_include(<pxr/usd/usd/stage.h>)
    auto host = std::make_unique<UsdStageHost>(pxr::UsdStage::Open(*root));
#else
    usdlive::stage::Stage stage(*root);
    auto host = std::make_unique<layers::ComposedStageHost>(stage);
#endif
    layers::ClientLayers liveLayers(live);
    layers::Layers editor(std::move(host), {.user = {argv[3]}, .live = &liveLayers});
    layers::LayersState& state = editor.state();

    // An edit goes to the layer with the strongest opinion, with the next frame.
    if (const auto set = editor.setEditMode(layers::LayerEditMode::AutoAuthoring); !set)
        return std::cerr << set.error().text << "\n", 1;
    comment(editor, "edited by " + std::string(argv[3]));
    clearDocumentation(editor);
    frame(live, editor);
    for (const auto& layer : state.dirtyLayerIdentifiers()) std::cout << "edited " << layer << "\n";

    // Nobody else can edit or unlock a locked layer. This API takes back own edits, too.
    const std::string weakest = state.localLayerIdentifiers(false, false, false).back();
    if (const auto locked = state.setLayerLockState(weakest, true); !locked)
        return std::cerr << locked.error().text << "\n", 1;
    frame(live, editor);
    comment(editor, "too late");
    frame(live, editor);
    for (const layers::RefusedEdit& edit : editor.refusedEdits())
        std::cout << "refused " << edit.path << ": " << edit.reason << "\n";

    editor.distribute();  // includes edits that wait for the next frame
    const auto saved = live.saveAndWait();
    if (!saved) return std::cerr << saved.error().message << "\n", 1;
    for (const auto& layer : saved->saved) std::cout << "saved " << layer.value << "\n";
    return 0;
}
