// Keeps the newest preview of each gesture in progress.
#include "stream/Previews.h"

namespace usdlive::server {

std::uint64_t Previews::keep(const ClientId& author, std::uint64_t gesture, Preview preview) {
    auto& gestures = kept_[author];
    gestures[gesture] = std::move(preview);
    if (gestures.size() <= kMaxGestures) return 0;
    // Clients number their gestures in ascending order. The new one stays, whatever its number.
    auto oldest = gestures.begin();
    if (oldest->first == gesture) ++oldest;
    const std::uint64_t pushedOut = oldest->first;
    gestures.erase(oldest);
    values.end(author, pushedOut);
    return pushedOut;
}

bool Previews::end(const ClientId& author, std::uint64_t gesture) {
    values.end(author, gesture);
    const auto found = kept_.find(author);
    if (found == kept_.end() || found->second.erase(gesture) == 0) return false;
    if (found->second.empty()) kept_.erase(found);
    return true;
}

std::vector<std::uint64_t> Previews::endAll(const ClientId& author) {
    values.endAll(author);
    std::vector<std::uint64_t> ended;
    const auto found = kept_.find(author);
    if (found == kept_.end()) return ended;
    for (const auto& [gesture, preview] : found->second) ended.push_back(gesture);
    kept_.erase(found);
    return ended;
}

void Previews::forEach(const std::function<void(const ClientId&, const Preview&)>& visit) const {
    for (const auto& [author, gestures] : kept_)
        for (const auto& [gesture, preview] : gestures) visit(author, preview);
}

}  // namespace usdlive::server
