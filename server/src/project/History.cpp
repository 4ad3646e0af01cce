// History that is bounded: commits of long ago give way to a base (CH4).
#include <algorithm>
#include <utility>

#include "ProjectImpl.h"
#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

namespace {

constexpr std::int64_t kDayMs = 24 * 60 * 60 * 1'000;
constexpr std::uint64_t kMostDays = 100'000;
constexpr std::size_t kMostCompacts = 16;  // that wait, of all sessions

/// When the commit was made. It may be large: of one in parts the first says it, of an import its
/// stub.
Result<std::int64_t> timeOf(const StoredCommit& stored) {
    StoredCommit read = stored;
    std::size_t offset = 0;
    if (isInParts(*stored.frame))
        read.frame = std::make_shared<const Bytes>(nextPart(*stored.frame, offset));
    auto stub = importStub(withoutLength(*read.frame), stored.hash);
    if (!stub) return tl::unexpected(stub.error());
    if (*stub) read.frame = std::make_shared<const Bytes>(std::move(**stub));
    return decodeCommit(read).map([](const Commit& commit) { return commit.timeMs; });
}

Result<std::int64_t> timeOf(const CommitStore& store, Revision revision) {
    Result<std::int64_t> time = fail(ErrorCode::StorageCorrupt,
                                     "commit " + std::to_string(revision) + " is not in the store");
    const auto read = store.read(revision, revision, [&](const StoredCommit& commit) {
        time = timeOf(commit);
        return false;
    });
    if (!read) return tl::unexpected(read.error());
    return time;
}

}  // namespace

/// Times grow with the revisions, but for what a clock that was set back does.
Result<BaseLimit> findBase(const CommitStore& store, std::int64_t beforeMs, Revision upTo) {
    BaseLimit limit{store.base().revision, {}};
    for (Revision newer = upTo + 1; limit.revision + 1 < newer;) {
        const Revision middle = limit.revision + (newer - limit.revision) / 2;
        const auto time = timeOf(store, middle);
        if (!time) return tl::unexpected(time.error());
        (*time < beforeMs ? limit.revision : newer) = middle;
    }
    const auto checkpoints = store.checkpoints();
    if (!checkpoints) return tl::unexpected(checkpoints.error());
    for (const Checkpoint& checkpoint : *checkpoints) {
        if (checkpoint.revision >= limit.revision) continue;
        limit = {checkpoint.revision, "the checkpoint '" + checkpoint.name + "' of revision " +
                                          std::to_string(checkpoint.revision)};
    }
    return limit;
}

void Project::Impl::boundHistory() {
    const bool waits = std::ranges::any_of(
        compacts_, [](const CompactRequest& request) { return !request.session; });
    if (!options_.historyDays || waits) return;
    compacts_.push_back(
        {{}, 0, ports_.clock.wallClockMs() - std::int64_t(*options_.historyDays) * kDayMs, 0, {}});
    if (compacts_.size() == 1) compactNext();
}

void Project::Impl::compactHistory(Session& session, const CompactHistory& request) {
    const auto refuse = [&](const char* why) {
        sendError(session, {ErrorCode::InvalidArgument, why}, request.request);
    };
    if (const auto denied = access_.toHistory(session.subject))
        return sendError(session, *denied, request.request);
    const auto days = request.days ? request.days : options_.historyDays;
    if (!days)
        return refuse(
            "say how old a commit has to be to be replaced: --days N. The server was "
            "started without --history-days");
    if (*days > kMostDays) return refuse("no commit is as old as that");
    if (compacts_.size() >= kMostCompacts)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    compacts_.push_back({session.id,
                         request.request,
                         ports_.clock.wallClockMs() - std::int64_t(*days) * kDayMs,
                         0,
                         {}});
    if (compacts_.size() == 1) compactNext();
}

/// A checkpoint that is made from now on is of what is durable now, or later.
void Project::Impl::compactNext() {
    if (!compacts_.empty()) ports_.history.findBase(compacts_.front().beforeMs, durable_);
}

void Project::Impl::baseFound(Result<BaseLimit> limit) {
    if (compacts_.empty()) return;
    if (!limit) return compactDone(tl::unexpected(limit.error()));
    if (const Revision needed = oldestNeeded(); needed < limit->revision)
        limit = BaseLimit{needed, "a client that is being sent revision " +
                                      std::to_string(needed + 1) + " and those after it"};
    compacts_.front().from = base_.revision;
    compacts_.front().keptFor = std::move(limit->keptFor);
    if (limit->revision <= base_.revision) return compactDone(CompactOutcome{});
    oldest_ = limit->revision;  // who comes from now on does not get what is older
    ports_.history.compact(oldest_);
}

/// Nobody who is connected asks the store for this revision's commit or an older one.
Revision Project::Impl::oldestNeeded() const {
    Revision oldest = durable_;
    const auto needs = [&oldest](Revision revision) { oldest = std::min(oldest, revision); };
    for (const auto& [id, session] : sessions_) {
        if (const auto* checking = std::get_if<CheckingResume>(&session.phase))
            if (checking->hello.resume) needs(checking->hello.resume->revision);
        for (const Read& read : session.reads) needs(read.from - 1);
        if (!session.isGreeted()) continue;
        needs(session.position);
        if (const auto* log = std::get_if<SendingLog>(&session.stream)) needs(log->next - 1);
        for (const RequestLog& log : session.logs) needs(log.from - 1);
        for (const auto& [request, open] : session.historyReads) needs(open.revision);
    }
    return oldest;
}

void Project::Impl::compacted(const Result<CompactOutcome>& outcome) {
    if (compacts_.empty()) return;
    oldest_ = base_.revision;
    compactDone(outcome);
}

/// It only grows.
void Project::Impl::baseIs(const CommitStore::Base& base) {
    if (base.revision > base_.revision) base_ = base;
    oldest_ = std::max(oldest_, base_.revision);
}

void Project::Impl::compactDone(const Result<CompactOutcome>& outcome) {
    const CompactRequest done = std::move(compacts_.front());
    compacts_.pop_front();
    Session* session = done.session ? find(*done.session) : nullptr;
    if (session && session->isGreeted()) {
        if (outcome)
            send(*session,
                 HistoryCompacted{done.request, base_.revision, base_.revision - done.from,
                                  outcome->bytesBefore, outcome->bytesAfter, done.keptFor});
        else
            sendError(*session, outcome.error(), done.request);
    }
    compactNext();
}

void Project::Impl::storageMeasured(SessionId id, std::uint64_t request, Result<Storage> storage) {
    Session* session = find(id);
    if (!session || !session->isGreeted()) return;
    if (!storage) return sendError(*session, storage.error(), request);
    storage->request = request;
    send(*session, *storage);
}

}  // namespace usdlive::server
