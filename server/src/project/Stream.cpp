// Commits of the past for sessions that resume or ask for the log, until they have caught up.
#include <algorithm>
#include <iterator>
#include <utility>

#include "ProjectImpl.h"
#include "usdlive/common/layer/Conflation.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/server/project/CommitContent.h"

namespace usdlive::server {

namespace {

constexpr Revision kPageCommits = 256;         // read from the store at once
constexpr std::size_t kMaxLogs = 16;           // asked for by one session and not begun
constexpr std::size_t kRunBytes = 512 * 1024;  // of commits of the past that are sent together

const std::string kConflation = "conflation";

// Commits behind one in parts are sent when all of that is.
bool canSend(const Session& session) { return session.isGreeted() && !session.sending; }

/// CF1: one for all of them, or nothing when each register was written once. Precondition: they
/// follow one another, and nobody waits for one of them.
std::optional<Bytes> conflatedFrame(std::vector<CommitFrame>& frames, const Hash& hashAfter) {
    std::vector<Edit> edits;
    for (CommitFrame& frame : frames)
        std::ranges::copy(frame.commit.edits, std::back_inserter(edits));
    const std::size_t all = edits.size();
    edits = conflated(std::move(edits));
    if (edits.size() == all) return std::nullopt;
    const Commit& last = frames.back().commit;
    CommitFrame made;
    made.commit.revision = last.revision;
    made.commit.epoch = last.epoch;
    made.commit.timeMs = last.timeMs;
    made.commit.previous = frames.front().commit.previous;
    made.commit.conflated = frames.size() - 1;
    made.commit.edits = std::move(edits);
    made.hashAfter = hashAfter;
    return encodeFrame(made);
}

}  // namespace

void Project::Impl::drained(SessionId id) {
    if (Session* session = find(id)) pump(*session);
}

void Project::Impl::pump(Session& session) {
    const auto streamReads = [&session] {
        return std::any_of(session.reads.begin(), session.reads.end(),
                           [](const Read& read) { return read.purpose == ReadPurpose::Stream; });
    };
    while (session.isGreeted() && !session.isLive() && !streamReads() &&
           !ports_.outbox.congested(session.id)) {
        if (session.sending) {
            sendPart(session);
            continue;
        }
        const auto* log = std::get_if<SendingLog>(&session.stream);
        const Revision next = log ? log->next : session.position + 1;
        const Revision last = log ? log->to : durable_;
        if (next > last)
            log ? endLog(session) : becomeLive(session);
        else if (!log && next + options_.maxBehind < last)
            return close(session, {ErrorCode::SlowReader, "too many commits behind"});
        else if (!sendRecent(session, last))
            requestRead(session,
                        {ReadPurpose::Stream, next, std::min(last, next + kPageCommits - 1)});
    }
}

/// False: what comes next is not in memory any more.
bool Project::Impl::sendRecent(Session& session, Revision last) {
    const auto* log = std::get_if<SendingLog>(&session.stream);
    std::vector<StoredCommit> run;
    std::size_t bytes = 0;
    for (Revision next = log ? log->next : session.position + 1;
         next <= last && run.size() < kPageCommits && bytes < kRunBytes; ++next) {
        const auto* recent = recent_.find(next);
        const SharedBytes large = recent ? nullptr : largeCommit(next);
        if (large && run.empty()) {
            sendPast(session, large);
            return true;
        }
        if (!recent) break;
        run.push_back({recent->revision, recent->frame, recent->hash});
        bytes += recent->frame->size();
    }
    if (!run.empty()) sendRun(session, run);
    return !run.empty();
}

/// Commits of the past as they are broadcast, in order; to who fell behind without what was written
/// again (CF1).
void Project::Impl::sendRun(Session& session, const std::vector<StoredCommit>& commits) {
    std::vector<CommitFrame> run;              // what may become one
    const auto flush = [&](std::size_t end) {  // the run's last is the one before `end`
        const auto frame =
            run.size() > 1 ? conflatedFrame(run, commits[end - 1].hash) : std::nullopt;
        std::size_t first = end - std::exchange(run, {}).size();
        if (frame) {
            session.position = commits[end - 1].revision - 1;
            return sendPast(session, std::make_shared<const Bytes>(*frame));
        }
        for (; first < end && canSend(session); ++first) sendPast(session, commits[first].frame);
    };
    for (std::size_t index = 0; index < commits.size() && canSend(session); ++index) {
        auto frame = conflatable(session, commits[index]);
        if (!frame) {
            flush(index);
            if (canSend(session)) sendPast(session, commits[index].frame);
            continue;
        }
        run.push_back(std::move(*frame));
        // The client begins here, or with a layer as of here: what follows applies to that.
        const Revision revision = commits[index].revision;
        if (revision == session.greetedAt || session.opened.contains(revision)) flush(index + 1);
    }
    if (canSend(session)) flush(commits.size());
}

/// Nothing: it is sent as it is, because its author waits for it, because it does more than its
/// edits, or because the session may have it already and not the ones around it.
std::optional<CommitFrame> Project::Impl::conflatable(const Session& session,
                                                      const StoredCommit& stored) {
    if (!std::holds_alternative<CatchingUp>(session.stream) || session.ahead ||
        !session.features.contains(kConflation) || isInParts(*stored.frame))
        return std::nullopt;
    auto frame = decodeFrame(withoutLength(*stored.frame));
    auto* found = frame ? std::get_if<CommitFrame>(&*frame) : nullptr;
    if (!found || found->commit.imported || found->commit.gesture != 0 ||
        found->commit.id.client == session.client)
        return std::nullopt;
    return std::move(*found);
}

void Project::Impl::sendPast(Session& session, const SharedBytes& frame) {
    if (!isInParts(*frame)) {
        ports_.outbox.send(session.id, frame);
        return wasSent(session);
    }
    const auto* log = std::get_if<SendingLog>(&session.stream);
    const Revision revision = log ? log->next : session.position + 1;
    newestInParts_ = std::max(newestInParts_, revision);
    if (!session.features.contains(kPartsFeature))
        return close(session, {ErrorCode::StaleBase, "commit " + std::to_string(revision) +
                                                         " comes in parts, which the client "
                                                         "cannot read: open the layers anew"});
    large_[revision] = frame;
    session.sending = SendingParts{frame};
}

/// The next part of a commit that comes in parts.
void Project::Impl::sendPart(Session& session) {
    SendingParts& sending = *session.sending;
    ports_.outbox.send(session.id,
                       std::make_shared<const Bytes>(nextPart(*sending.frame, sending.offset)));
    if (sending.offset < sending.frame->size()) return;
    session.sending.reset();
    wasSent(session);
}

/// A commit in parts that some session is being sent.
SharedBytes Project::Impl::largeCommit(Revision revision) {
    const auto found = large_.find(revision);
    if (found == large_.end()) return nullptr;
    SharedBytes frame = found->second.lock();
    if (!frame) large_.erase(found);
    return frame;
}

/// All of the commit that was next.
void Project::Impl::wasSent(Session& session) {
    ++counters_.delivered;
    if (auto* log = std::get_if<SendingLog>(&session.stream)) {
        ++log->next;
        return;
    }
    ++session.position;
    session.opened.erase(session.opened.begin(), session.opened.upper_bound(session.position));
    releaseAnswers(session);
}

void Project::Impl::becomeLive(Session& session) {
    if (!session.logs.empty()) return beginLog(session);
    session.stream = Live{};
    session.ahead = false;
    ports_.outbox.releaseCommits(session.id, session.position + 1);
    previews_.forEach([&](const ClientId& author, const Previews::Preview& preview) {
        if (author != session.client) ports_.outbox.send(session.id, preview.frame);
    });
}

void Project::Impl::requestLog(Session& session, const RequestLog& request) {
    const Revision to = request.to == 0 ? durable_ : request.to;
    if (to > durable_ || request.from > durable_)
        return sendError(
            session,
            {ErrorCode::FutureRevision, "the newest revision is " + std::to_string(durable_)},
            request.request);
    const Revision from = request.from == 0 ? oldest_ + 1 : request.from;
    if (from <= oldest_)
        return sendError(session, historyReplaced(from, oldest_).value(), request.request);
    if (session.logs.size() >= kMaxLogs)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    session.logs.push_back({request.request, from, to});
    if (session.isLive()) beginLog(session);
    pump(session);
}

void Project::Impl::beginLog(Session& session) {
    const RequestLog request = session.logs.front();
    session.logs.pop_front();
    if (session.isLive()) session.ahead = ports_.outbox.holdCommits(session.id);
    session.stream = SendingLog{request.request, request.from, request.to};
    send(session, LogBegin{request.request});
}

void Project::Impl::endLog(Session& session) {
    send(session, LogEnd{std::get<SendingLog>(session.stream).request});
    session.stream = CatchingUp{};
}

void Project::Impl::releaseAnswers(Session& session) {
    auto& answers = session.answers;
    while (session.isGreeted() && !answers.empty() && answers.front().after <= session.position) {
        const Answer answer = std::move(answers.front());
        answers.pop_front();
        ports_.outbox.send(session.id, answer.frame);
        if (!answer.closing) continue;
        ports_.outbox.close(session.id);
        session.phase = Closing{};
    }
}

std::optional<Hash> Project::Impl::knownHash(Revision revision) const {
    if (revision == base_.revision) return base_.hash;
    if (revision == durable_) return durableHash_;
    const auto* recent = recent_.find(revision);
    return recent ? std::optional(recent->hash) : std::nullopt;
}

void Project::Impl::requestRead(Session& session, Read read) {
    session.reads.push_back(read);
    if (session.reads.size() == 1) ports_.history.readCommits(session.id, read.from, read.to);
}

void Project::Impl::commitsRead(SessionId id, Result<std::vector<StoredCommit>> commits) {
    Session* session = find(id);
    if (!session || session->reads.empty()) return;
    const Read read = session->reads.front();
    session->reads.pop_front();
    if (!session->reads.empty())
        ports_.history.readCommits(id, session->reads.front().from, session->reads.front().to);
    if (commits && (commits->empty() || commits->front().revision != read.from))
        commits = fail(ErrorCode::StorageCorrupt,
                       "revision " + std::to_string(read.from) + " is not in the store");
    switch (read.purpose) {
        case ReadPurpose::ResumeCheck:
            return resumeChecked(*session,
                                 commits.map([](const auto& found) { return found.front().hash; }));
        case ReadPurpose::Stream:
            return streamRead(*session, std::move(commits));
        case ReadPurpose::Creations:
            if (commits) learnCreations(authors_[session->client], read.sequence, commits->front());
            return work(*session);
    }
}

void Project::Impl::streamRead(Session& session, Result<std::vector<StoredCommit>> commits) {
    if (!session.isGreeted()) return;
    if (!commits) return close(session, commits.error());
    for (StoredCommit& commit : *commits) {
        if (isInParts(*commit.frame)) {
            if (const SharedBytes shared = largeCommit(commit.revision)) commit.frame = shared;
            continue;
        }
        auto stub = importStub(withoutLength(*commit.frame), commit.hash);
        if (!stub) return close(session, stub.error());
        if (*stub) commit.frame = std::make_shared<const Bytes>(std::move(**stub));
    }
    sendRun(session, *commits);
    pump(session);
}

}  // namespace usdlive::server
