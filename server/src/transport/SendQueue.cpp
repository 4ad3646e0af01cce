// A queue of frames for one connection.
#include "transport/SendQueue.h"

#include <utility>

namespace usdlive::server {

void SendQueue::push(SharedBytes frames) {
    bytes_ += frames->size();
    entries_.push_back(std::move(frames));
}

void SendQueue::take(std::size_t most, std::vector<SharedBytes>& out) {
    out.clear();
    if (bytes_ <= most) {
        out.swap(entries_);  // both vectors keep their capacity for reuse
        bytes_ = 0;
        return;
    }
    std::size_t taken = 0;
    auto end = entries_.begin();
    do taken += (*end++)->size();
    while (end != entries_.end() && taken + (*end)->size() <= most);
    out.assign(std::make_move_iterator(entries_.begin()), std::make_move_iterator(end));
    entries_.erase(entries_.begin(), end);
    bytes_ -= taken;
}

void SendQueue::clear() {
    entries_.clear();
    bytes_ = 0;
}

}  // namespace usdlive::server
