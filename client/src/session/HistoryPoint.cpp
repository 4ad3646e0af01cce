// Compares the history of a server with the one that the client has.
#include "session/HistoryPoint.h"

#include <algorithm>
#include <utility>

namespace usdlive::client {

namespace {

// ID2: another project, or a store that was restored from a copy. Names no revisions, so that the
// same situation is reported once.
Error explained(const OtherHistory& other) {
    const std::string expected = namedHistory(other.expectedProject, other.expectedStore);
    const std::string what =
        other.isOtherProject()
            ? "it serves another project, " + namedHistory(other.foundProject, other.foundStore) +
                  ", and this editor has " + expected +
                  " open. Another folder is served at this address, or the project's .usdlive was "
                  "deleted. Nothing was sent. Serve the right one again, and work continues"
            : "commits of " + expected +
                  " that this editor has received are not in it. The project's .usdlive was "
                  "replaced by an older one or by another copy. Nothing was sent. Put the right "
                  "one back and start the server again, and work continues";
    return {ErrorCode::HistoryDiverged,
            "the server has another history than this editor: " + what +
                "; or close this connection and connect again: what was not sent is kept, and "
                "unsent_work() shows it; or call join_other_history(): what the server lacks " +
                (other.isOtherProject() ? "and what was not sent become lost work"
                                        : "becomes lost work, and what was not sent is sent")};
}

}  // namespace

std::string namedHistory(const std::string& project, const StoreId& store) {
    return "\"" + project + "\" (store " + (store.empty() ? "unknown" : store.value.substr(0, 8)) +
           ")";
}

// ---- a connection

std::optional<Hello::Resume> HistoryPoint::connecting() {
    forgotten_.reset();
    diverged_ = false;
    if (!isKnown_) return std::nullopt;
    Hello::Resume resume{commitEpoch_, revision_, hash_};
    if (!store_.empty()) resume.store = store_;
    if (hasUnanswered()) resume.unansweredSince = unanswered_->since;
    return resume;
}

bool HistoryPoint::hasUnanswered() const {
    return unanswered_ && std::ranges::any_of(pending_, [&](const Pending& pending) {
               return pending.everSent && pending.transaction.id.sequence <= unanswered_->last;
           });
}

bool HistoryPoint::takesBeforeWelcome(const ErrorMessage& message) {
    const Error error = toError(message);
    if (error.code == ErrorCode::ClientForgotten) {
        forgotten_ = error;
        return diverged_;
    }
    const bool differs =
        error.code == ErrorCode::HistoryDiverged || error.code == ErrorCode::FutureRevision;
    if (!differs || message.closing) return false;
    return diverged_ = true;
}

// ---- a welcome

HistoryPoint::Found HistoryPoint::compare(const Welcome& found, const std::string& project) {
    OtherHistory other{.expectedProject = project,
                       .foundProject = found.project,
                       .expectedStore = store_,
                       .foundStore = found.store.value_or(StoreId{}),
                       .reason = {}};
    const bool isSame = !other.isOtherProject() && !diverged_ && found.epoch >= epoch_;
    if (!isKnown_ || isSame) return Found::Same;
    other.reason = explained(other);
    other_ = std::move(other);
    return accepted_ == other_->foundStore ? Found::AcceptedOther : Found::Other;
}

void HistoryPoint::welcomed(const Welcome& message) {
    other_.reset();
    accepted_.reset();
    epoch_ = message.epoch;
    store_ = message.store.value_or(store_);
}

void HistoryPoint::leaveUnanswered(Revision joined) {
    std::uint64_t last = 0;
    for (const Pending& pending : pending_)
        if (pending.everSent) last = std::max(last, pending.transaction.id.sequence);
    const Revision since = hasUnanswered() ? unanswered_->since : revision_;
    // Another history may be shorter than the one that the client leaves (ID4).
    if (last != 0) unanswered_ = {std::min(since, joined), last};
}

void HistoryPoint::beginAt(const Welcome& message) {
    revision_ = message.revision;
    hash_ = message.hash;
    commitEpoch_ = 0;
    isKnown_ = true;
}

Result<void> HistoryPoint::acceptOther() {
    if (!other_)
        return fail(ErrorCode::InvalidArgument,
                    "the server has no other history than this editor: there is none to join");
    accepted_ = other_->foundStore;
    return {};
}

// ---- commits

bool HistoryPoint::isPast(const Commit& commit) const {
    return commit.revision <= revision_ || commit.epoch < commitEpoch_;
}

Result<void> HistoryPoint::advance(ReceivedCommit& received) {
    Commit& commit = received.commit;
    const bool continues =
        received.isCompact ? beginsLike(commit.previous, hash_) : commit.previous == hash_;
    if (commit.revision - commit.conflated != revision_ + 1 || !continues)
        return fail(ErrorCode::HistoryDiverged, "commit " + std::to_string(commit.revision) +
                                                    " does not follow the one before");
    commit.previous = std::exchange(hash_, received.hashAfter);
    commitEpoch_ = commit.epoch;
    revision_ = commit.revision;
    return {};
}

}  // namespace usdlive::client
