// Decides how far the history is replaced by a base, and passes it to the store.
#include "project/upkeep/Compaction.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

namespace {

constexpr std::int64_t kDayMs = 24 * 60 * 60 * 1'000;
constexpr std::uint64_t kMostDays = 100'000;
constexpr std::size_t kMostCompacts = 16;  // waiting requests of all sessions

}  // namespace

Compaction::Compaction(std::optional<std::uint64_t> historyDays, const Parts& parts,
                       const Ports& ports)
    : historyDays_(historyDays),
      line_(parts.line),
      start_(parts.start),
      sessions_(parts.sessions),
      access_(parts.access),
      greeting_(parts.greeting),
      reads_(parts.reads),
      catchup_(parts.catchup),
      openings_(parts.openings),
      history_(ports.history),
      activity_(ports.activity),
      time_(parts.time) {}

void Compaction::boundHistory() {
    const bool waits =
        std::ranges::any_of(requests_, [](const Request& one) { return !one.session; });
    if (historyDays_ && !waits) add(std::nullopt, 0, *historyDays_);
}

void Compaction::request(Session& session, const CompactHistory& request) {
    const auto refuse = [&](const char* why) {
        sessions_->sendError(session, {ErrorCode::InvalidArgument, why}, request.request);
    };
    if (const auto denied = access_->toHistory(session.subject)) {
        activity_->record({"compaction refused", session.subject.user, {}, denied->message});
        return sessions_->sendError(session, *denied, request.request);
    }
    const auto days = request.days ? request.days : historyDays_;
    if (!days)
        return refuse(
            "set the age of the commits to be replaced: --days N. The server was "
            "started without --history-days");
    if (*days > kMostDays) return refuse("no commit is so old");
    if (requests_.size() >= kMostCompacts)
        return sessions_->close(session,
                                {ErrorCode::MalformedControl, "too many requests at once"});
    add(session.id, request.request, *days);
}

void Compaction::add(const std::optional<SessionId>& session, std::uint64_t request,
                     std::uint64_t days) {
    requests_.push_back(
        {session, request, time_->earliestMs() - std::int64_t(days) * kDayMs, 0, {}});
    if (requests_.size() == 1) findNextBase();
}

/// The limit is the durable revision: a checkpoint that is created from now on has this or a later
/// one.
void Compaction::findNextBase() {
    if (!requests_.empty()) history_->findBase(requests_.front().beforeMs, line_->durable());
}

void Compaction::baseFound(Result<BaseLimit> limit) {
    if (requests_.empty()) return;
    if (!limit) return finish(tl::unexpected(limit.error()));
    if (const Revision needed = oldestNeeded(); needed < limit->revision)
        limit = BaseLimit{needed, "a client that is being sent revision " +
                                      std::to_string(needed + 1) + " and those after it"};
    const Revision base = start_->base().revision;
    requests_.front().from = base;
    requests_.front().keptFor = std::move(limit->keptFor);
    if (limit->revision <= base) return finish(CompactOutcome{});
    start_->replacing(limit->revision);
    history_->compact(limit->revision);
}

/// Returns a revision: no session needs the commits up to it from the store.
Revision Compaction::oldestNeeded() const {
    return std::min(
        {greeting_->oldestNeeded(line_->durable()), reads_->oldestNeeded(line_->durable()),
         catchup_->oldestNeeded(line_->durable()), openings_->oldestNeeded(line_->durable())});
}

void Compaction::compacted(const Result<CompactOutcome>& outcome) {
    if (requests_.empty()) return;
    start_->replacingEnded();
    finish(outcome);
}

void Compaction::finish(const Result<CompactOutcome>& outcome) {
    const Request done = std::move(requests_.front());
    requests_.pop_front();
    const Session* session = done.session ? sessions_->greeted(*done.session) : nullptr;
    const Revision base = start_->base().revision;
    if (session && outcome) {
        activity_->record({"history compacted",
                           session->subject.user,
                           {},
                           "up to revision " + std::to_string(base)});
        sessions_->send(*session,
                        HistoryCompacted{done.request, base, base - done.from, outcome->bytesBefore,
                                         outcome->bytesAfter, done.keptFor});
    } else if (session)
        sessions_->sendError(*session, outcome.error(), done.request);
    findNextBase();
}

void Compaction::measure(const Session& session, const RequestStorage& request) {
    history_->measureStorage(session.id, request.request);
}

void Compaction::measured(SessionId id, std::uint64_t request, Result<Storage> storage) {
    const Session* session = sessions_->greeted(id);
    if (!session) return;
    if (!storage) return sessions_->sendError(*session, storage.error(), request);
    storage->request = request;
    sessions_->send(*session, *storage);
}

}  // namespace usdlive::server
