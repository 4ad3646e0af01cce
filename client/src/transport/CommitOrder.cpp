// Orders the commits of the topic with the messages of the stream (DD5-DD7).
#include "transport/CommitOrder.h"

#include <algorithm>
#include <utility>

namespace usdlive::client {

using Message = dds::SegmentReceiver::Message;

void CommitOrder::commit(Revision revision, std::uint64_t position, SharedBytes frame) {
    sent(revision);
    if (revision < next_) return;
    const auto [entry, inserted] = held_.try_emplace(revision, Held{position, std::move(frame)});
    if (!inserted) return;
    heldBytes_ += entry->second.frame->size();
    // Drops the last commit, because it is needed last. Before the stream is live, drops the first,
    // because the server sends it itself.
    while (held_.size() > 1 && (held_.size() > kHeldCommits || heldBytes_ > kHeldBytes))
        drop(live_ ? std::prev(held_.end()) : held_.begin());
}

void CommitOrder::drop(std::map<Revision, Held>::iterator entry) {
    heldBytes_ -= entry->second.frame->size();
    held_.erase(entry);
}

std::optional<Message> CommitOrder::take(dds::TimePoint now) {
    auto message = takeReply(now);
    if (!message) message = takeCommit();
    look(now);
    return message;
}

std::optional<Message> CommitOrder::takeReply(dds::TimePoint now) {
    const auto mark = replies_.next();
    if (!mark || (mark->afterCommit != 0 && next_ <= mark->afterCommit)) return std::nullopt;
    auto message = replies_.take(now);
    if (!message) return std::nullopt;
    if (message->mark.hold) live_ = false;
    if (const Revision from = message->mark.liveFrom; from != 0) {
        live_ = true;
        next_ = std::max(next_, from);
        while (!held_.empty() && held_.begin()->first < next_) drop(held_.begin());
    }
    return message;
}

std::optional<Message> CommitOrder::takeCommit() {
    if (!live_ || held_.empty()) return std::nullopt;
    const auto first = held_.begin();
    if (first->first != next_ || first->second.position > replies_.bytesTaken())
        return std::nullopt;
    Message message{first->second.frame, {}};
    drop(first);
    ++next_;
    return message;
}

/// Returns the last commit of the first gap from `next_` on, or 0 if there is no gap.
Revision CommitOrder::lastMissing() const {
    if (!live_) return 0;
    if (!held_.empty()) return held_.begin()->first > next_ ? held_.begin()->first - 1 : 0;
    const auto mark = replies_.next();
    const Revision known = std::max(sent_, mark ? mark->afterCommit : 0);
    return known >= next_ ? known : 0;
}

void CommitOrder::look(dds::TimePoint now) {
    if (lastMissing() == 0)
        missingSince_.reset();
    else if (!missingSince_ || std::exchange(missing_, next_) != next_)
        missingSince_ = now;
    missing_ = next_;
}

std::optional<CommitOrder::Range> CommitOrder::nextRequest(dds::TimePoint now) {
    look(now);
    const auto due = deadline();
    if (!due || now < *due) return std::nullopt;
    const Range range{next_, std::min(lastMissing(), next_ + kRequestCommits - 1)};
    requestedTo_ = range.to;
    missingSince_ = now;
    return range;
}

std::optional<dds::TimePoint> CommitOrder::deadline() const {
    if (!missingSince_) return std::nullopt;
    // All requested commits have arrived, and more are missing.
    const bool answered = requestedTo_ != 0 && requestedTo_ + 1 == next_;
    return answered ? *missingSince_ : *missingSince_ + kRequestDelay;
}

}  // namespace usdlive::client
