// Keeps the newest preview of each gesture in progress.
#include "project/stream/Previews.h"

namespace usdlive::server {

std::size_t Previews::bytesOf(const Preview& preview) {
    constexpr std::size_t kEntryBytes = 256;
    return kEntryBytes + preview.frame->size() + preview.named.size() * sizeof(Hash);
}

void Previews::drop(std::map<ClientId, Gestures>::iterator author, Gestures::iterator gesture) {
    values.end(author->first, gesture->first);
    bytes_.giveBack(author->first, bytesOf(gesture->second));
    author->second.erase(gesture);
    if (author->second.empty()) kept_.erase(author);
}

std::vector<Previews::Gesture> Previews::keep(const ClientId& author, const std::string& share,
                                              std::uint64_t gesture, Preview preview) {
    Gestures& gestures = kept_[author];
    const std::size_t bytes = bytesOf(preview);
    const auto before = gestures.find(gesture);
    if (before != gestures.end()) bytes_.giveBack(author, bytesOf(before->second));
    gestures.insert_or_assign(gesture, std::move(preview));
    bytes_.take(author, bytes, share);

    std::vector<Gesture> pushedOut;
    // Clients number their gestures in ascending order. The new one stays, whatever its number.
    const auto dropOldest = [&](std::map<ClientId, Gestures>::iterator of) {
        auto oldest = of->second.begin();
        if (of->first == author && oldest->first == gesture && of->second.size() > 1) ++oldest;
        pushedOut.emplace_back(of->first, oldest->first);
        drop(of, oldest);
    };
    if (gestures.size() > kMaxGestures) dropOldest(kept_.find(author));
    while (const auto most = bytes_.givesWay(author)) dropOldest(kept_.find(*most));
    return pushedOut;
}

bool Previews::end(const ClientId& author, std::uint64_t gesture) {
    values.end(author, gesture);
    const auto found = kept_.find(author);
    if (found == kept_.end()) return false;
    const auto preview = found->second.find(gesture);
    if (preview == found->second.end()) return false;
    drop(found, preview);
    return true;
}

std::vector<std::uint64_t> Previews::endAll(const ClientId& author) {
    values.endAll(author);
    bytes_.giveBackAll(author);
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
