// Finds the layers that this process has loaded.
#include "usd/live/LoadedLayers.h"

#include <algorithm>
#include <chrono>
#include <mutex>
#include <vector>

namespace usdlive::client {

using Clock = std::chrono::steady_clock;

namespace {

constexpr auto kPause = std::chrono::milliseconds(100);
constexpr int kPart = 20;

}  // namespace

struct LoadedLayers::State {
    void look(const Known& known) {
        const auto begin = Clock::now();
        std::vector<pxr::SdfLayerHandle> added, others;
        Known present;
        for (const pxr::SdfLayerHandle& layer : pxr::SdfLayer::GetLoadedLayers()) {
            const void* id = layer.GetUniqueIdentifier();
            if (known.contains(id)) continue;
            present.insert(id);
            (before.contains(id) ? others : added).push_back(layer);
        }
        before = std::move(present);
        // next() takes them from the end.
        others.insert(others.end(), added.begin(), added.end());
        const auto end = Clock::now();
        const std::lock_guard lock(mutex);
        found = std::move(others);
        dueAt = end + std::max<Clock::duration>(kPause, (end - begin) * kPart);
        isLooking = false;
    }

    Known before;      // used by the worker only: the result of the last search
    std::mutex mutex;  // guards all members below
    std::vector<pxr::SdfLayerHandle> found;
    bool isLooking = false;
    bool again = false;  // a layer was opened after the search had begun
    Clock::time_point dueAt;
};

LoadedLayers::LoadedLayers() : state_(std::make_shared<State>()) {}
LoadedLayers::~LoadedLayers() = default;

void LoadedLayers::look(bool just, const std::shared_ptr<const Known>& known, Worker& worker) {
    const std::lock_guard lock(state_->mutex);
    state_->again = state_->again || just;
    const bool isDue = state_->found.empty() && Clock::now() >= state_->dueAt;
    if (state_->isLooking || (!state_->again && !isDue)) return;
    state_->isLooking = true;
    state_->again = false;
    worker.post([state = state_, known] { state->look(*known); });
}

pxr::SdfLayerRefPtr LoadedLayers::next() {
    const std::lock_guard lock(state_->mutex);
    while (!state_->found.empty()) {
        const pxr::SdfLayerHandle layer = std::move(state_->found.back());
        state_->found.pop_back();
        if (layer) return pxr::SdfLayerRefPtr(layer);
    }
    return {};
}

}  // namespace usdlive::client
