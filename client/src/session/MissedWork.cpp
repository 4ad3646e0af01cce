// Reads the commits of own work from the log of the past.
#include "session/MissedWork.h"

#include <algorithm>

namespace usdlive::client {

void MissedWork::add(Revision revision, Pending pending) {
    works_.push_back({revision, std::move(pending)});
    read();
}

void MissedWork::welcomed() {
    for (Work& work : works_) work.asked = false;
    read();
}

// A server reads a few logs at once for a client, and there may be many of these.
void MissedWork::read() {
    constexpr std::ptrdiff_t kAtOnce = 8;
    auto asked = std::ranges::count(works_, true, &Work::asked);
    for (std::size_t index = 0; index < works_.size() && asked < kAtOnce; ++index) {
        if (works_[index].asked) continue;
        works_[index].asked = true;
        ++asked;
        read(works_[index]);
    }
}

void MissedWork::read(const Work& work) {
    const std::uint64_t sequence = work.pending.transaction.id.sequence;
    const auto each = [this, sequence](const Commit& commit) {
        const auto entry = find(sequence);
        if (entry == works_.end() || commit.id != entry->pending.transaction.id) return;
        if (!commit.dropped.empty()) events_.reportDropped(entry->pending, commit);
        works_.erase(entry);
        events_.push(event::Committed{commit, true});
        read();
    };
    const auto done = [this, sequence](const Result<void>& read) {
        const auto entry = find(sequence);
        if (!channel_.isOnline() || entry == works_.end()) return;  // asked again, or answered
        events_.push(
            event::Lost{{.sequence = sequence,
                         .gesture = entry->pending.transaction.gesture,
                         .reason = {read ? ErrorCode::HistoryDiverged : read.error().code,
                                    "it was committed in a history that cannot be read any more"},
                         .refused = false,
                         .edits = std::move(entry->pending.authored)}});
        works_.erase(entry);
        this->read();
    };
    requests_.requestLog(work.revision, work.revision, each, done);
}

std::vector<MissedWork::Work>::iterator MissedWork::find(std::uint64_t sequence) {
    return std::ranges::find_if(
        works_, [&](const Work& work) { return work.pending.transaction.id.sequence == sequence; });
}

}  // namespace usdlive::client
