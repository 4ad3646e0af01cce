// Keeps the big values that previews name.
#include "project/stream/PreviewValues.h"

#include <algorithm>
#include <memory>
#include <utility>

namespace usdlive::server {

namespace {

// The memory of a part in addition to its data.
constexpr std::size_t kPartBytes = 256;

}  // namespace

void PreviewValues::add(const ClientId& author, const std::string& share, BlobFrame part) {
    auto found = entries_.find(part.hash);
    if (found != entries_.end() && found->second.written == found->second.size) {
        Entry& whole = found->second;  // it now belongs to this gesture
        bytes_.giveBack(std::exchange(whole.author, author), whole.bytes);
        bytes_.take(author, whole.bytes, share);
        whole.gesture = part.gesture;
        return;
    }
    if (found != entries_.end() && part.offset == 0) {
        erase(found);
        found = entries_.end();
    }
    if (found == entries_.end()) {
        if (part.offset != 0) return;
        found =
            entries_.emplace(part.hash, Entry{author, part.gesture, part.size, 0, 0, {}, {}}).first;
        found->second.turn = turns_.insert(turns_.end(), part.hash);
    }
    Entry& entry = found->second;
    if (part.offset != entry.written || part.size != entry.size) {
        erase(found);
        return;
    }
    const std::size_t bytes = part.data.size() + kPartBytes;
    entry.written += part.rawBytes;
    entry.bytes += bytes;
    bytes_.take(entry.author, bytes, share);
    entry.frames.push_back(std::make_shared<const Bytes>(encodeFrame(part)));
    while (const auto over = bytes_.givesWay(author))
        erase(entries_.find(*std::ranges::find_if(
            turns_, [&](const Hash& hash) { return entries_.at(hash).author == *over; })));
}

const std::vector<SharedBytes>* PreviewValues::find(const Hash& hash) const {
    const auto found = entries_.find(hash);
    if (found == entries_.end() || found->second.written < found->second.size) return nullptr;
    return &found->second.frames;
}

PreviewValues::Entries::iterator PreviewValues::erase(Entries::iterator entry) {
    bytes_.giveBack(entry->second.author, entry->second.bytes);
    turns_.erase(entry->second.turn);
    return entries_.erase(entry);
}

template <class Ends>
void PreviewValues::endIf(const Ends& ends) {
    for (auto entry = entries_.begin(); entry != entries_.end();)
        entry = ends(entry->second) ? erase(entry) : std::next(entry);
}

void PreviewValues::end(const ClientId& author, std::uint64_t gesture) {
    endIf([&](const Entry& entry) { return entry.author == author && entry.gesture == gesture; });
}

void PreviewValues::endAll(const ClientId& author) {
    endIf([&](const Entry& entry) { return entry.author == author; });
}

}  // namespace usdlive::server
