// Turns the editor's writes of one frame into a transaction of the session.
#include "usd/live/EditorFrame.h"

#include <pxr/usd/sdf/changeBlock.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "basics/Clocks.h"
#include "usd/places/OutsidePaths.h"

namespace usdlive::client {

void EditorFrame::seal(LiveSet& layers, Session& session) { submit(take(layers), session); }

std::vector<AuthoredEdit> EditorFrame::take(LiveSet& layers) {
    holdsBack_ = false;
    std::vector<AuthoredEdit> edits;
    for (LiveLayer* live : layers.active()) {
        auto sealed = live->seal();
        std::move(sealed.edits.begin(), sealed.edits.end(), std::back_inserter(edits));
        for (auto& write : sealed.lost) {
            LostWork work;
            work.reason = std::move(write.reason);
            work.edits = std::move(write.edits);
            lost_.add(std::move(work));
        }
    }
    encodings_.clear();
    return edits;
}

void EditorFrame::submit(std::vector<AuthoredEdit> edits, Session& session) {
    if (edits.empty()) return;
    auto outside = outsidePaths(edits, folders_, blobs_);
    std::move(outside.begin(), outside.end(), std::back_inserter(outside_));
    session.author(std::move(edits));
}

bool EditorFrame::sealWhenEncoded(LiveSet& layers, Session& session) {
    std::vector<pxr::VtValue> arrays;
    for (const LiveLayer* live : layers.active()) live->appendBigArrays(arrays);
    holdsBack_ = !encodings_.areReady(std::move(arrays), steadyMs());
    if (!holdsBack_) seal(layers, session);
    return !holdsBack_;
}

bool EditorFrame::hasWrites(LiveSet& layers) {
    return std::ranges::any_of(layers.active(), &LiveLayer::hasWrites);
}

void EditorFrame::author(LiveSet& layers, Session& session, LiveLayer& live,
                         std::vector<EditAction> actions, const std::function<void()>& alongside) {
    const pxr::SdfChangeBlock frame;
    if (alongside) alongside();
    std::vector<AuthoredEdit> edits = take(layers);
    {
        usd::SdfLayerStore::Block block;
        for (EditAction& action : actions) {
            live.apply("/", action, block);
            edits.push_back({live.id(), "/", std::move(action)});
        }
    }
    submit(std::move(edits), session);
}

void saveAgain(LiveSet& layers, const LayerPlaces& cache, Session& session) {
    if (!session.isConnected()) return;
    std::vector<LayerId> files, placeholders;
    for (LiveLayer* live : layers.active())
        if (live->takeSaved())
            (cache.layerOf(live->layer()) ? placeholders : files).push_back(live->id());
    if (!files.empty()) session.request(SaveLayers{.layers = std::move(files), .force = true});
    if (!placeholders.empty()) session.request(SaveLayers{.layers = std::move(placeholders)});
}

}  // namespace usdlive::client
