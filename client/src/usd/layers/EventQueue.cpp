// Merges the events of a frame.
#include "usd/layers/EventQueue.h"

#include <algorithm>
#include <unordered_set>
#include <utility>

namespace usdlive::layers {

namespace {

void append(std::vector<std::string>& all, std::vector<std::string> more) {
    for (auto& one : more)
        if (std::ranges::find(all, one) == all.end()) all.push_back(std::move(one));
}

void append(LayerEvent::Entries& all, LayerEvent::Entries more) {
    for (auto& [key, values] : more) {
        const auto found =
            std::ranges::find(all, key, [](const auto& entry) { return entry.first; });
        if (found == all.end())
            all.emplace_back(std::move(key), std::move(values));
        else
            append(found->second, std::move(values));
    }
}

// Removes duplicates and keeps the order.
void distinct(std::vector<pxr::SdfPath>& paths) {
    std::unordered_set<pxr::SdfPath, pxr::SdfPath::Hash> seen;
    std::erase_if(paths, [&](const auto& path) { return !seen.insert(path).second; });
}

}  // namespace

void EventQueue::push(LayerEvent event) {
    for (auto& queued : events_) {
        if (queued.type != event.type || queued.layer != event.layer) continue;
        append(queued.values, std::move(event.values));
        append(queued.entries, std::move(event.entries));
        queued.paths.insert(queued.paths.end(), event.paths.begin(), event.paths.end());
        return;
    }
    events_.push_back(std::move(event));
}

void EventQueue::push(LayerEventType type, std::vector<std::string> values) {
    LayerEvent event;
    event.type = type;
    event.values = std::move(values);
    push(std::move(event));
}

std::vector<LayerEvent> EventQueue::take() {
    for (auto& event : events_) distinct(event.paths);
    return std::exchange(events_, {});
}

}  // namespace usdlive::layers
