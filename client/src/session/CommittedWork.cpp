// Follows own committed work through moves, and finds what a delete has taken.
#include "session/CommittedWork.h"

#include <algorithm>
#include <utility>

namespace usdlive::client {

void CommittedWork::add(const NamespaceLog& log, const Commit& commit, Pending pending) {
    Work work{commit.revision, commit.id.sequence, pending.sentBytes, {}};
    if (pending.authored.size() > kMostEdits || work.bytes > kMostBytes) return;
    forEachExecuted(log, commit, [&](const Edit& edit, std::uint32_t index, std::uint64_t mark) {
        if (index >= pending.authored.size()) return;  // the server has added it
        const auto* move = std::get_if<MoveSpec>(&edit.action);
        const bool writes = !concernsPlace(edit.action) &&
                            !std::holds_alternative<DeleteSpec>(edit.action) &&
                            edit.address.path != "/";
        if (writes)
            work.edits.push_back({move ? destination(edit.address.path, *move) : edit.address.path,
                                  mark, std::move(pending.authored[index])});
    });
    if (work.edits.empty()) return;
    edits_ += work.edits.size();
    bytes_ += work.bytes;
    work_.push_back(std::move(work));
    while (edits_ > kMostEdits || bytes_ > kMostBytes) {
        edits_ -= work_.front().edits.size();
        bytes_ -= work_.front().bytes;
        work_.pop_front();
    }
}

std::deque<CommittedWork::Work>::iterator CommittedWork::from(Revision first) {
    return std::ranges::lower_bound(work_, first, {}, &Work::revision);
}

void CommittedWork::follow(const NamespaceLog& log, Revision first) {
    for (auto work = from(first); work != work_.end(); ++work) {
        edits_ -= std::erase_if(work->edits, [&](Written& written) {
            if (written.mark == log.mark()) return false;
            auto now = log.translateFrom(written.edit.layer, std::move(written.path), written.mark);
            written.path = now ? *std::move(now) : std::string();
            written.mark = log.mark();
            return written.path.empty();
        });
    }
}

std::optional<LostWork> CommittedWork::takenBy(const NamespaceLog& log, const Commit& commit) {
    if (commit.firstUnseen == 0) return std::nullopt;
    LostWork lost{
        .sequence = 0,
        .gesture = 0,
        .reason = {ErrorCode::DeletedUnseen, std::string(errorText(ErrorCode::DeletedUnseen)) +
                                                 " It was " + commit.user.value + "."},
        .refused = false,
        .edits = {}};
    for (auto work = from(commit.firstUnseen); work != work_.end(); ++work) {
        const auto taken = std::erase_if(work->edits, [&](Written& written) {
            if (log.translateFrom(written.edit.layer, written.path, written.mark)) return false;
            lost.edits.push_back(std::move(written.edit));
            return true;
        });
        edits_ -= taken;
        if (taken > 0) lost.sequence = work->sequence;
    }
    if (lost.edits.empty()) return std::nullopt;
    return lost;
}

}  // namespace usdlive::client
