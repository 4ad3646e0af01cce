// Sends durable commits to all sessions, and decides which commits a session is sent next.
#include "project/stream/Catchup.h"

#include <algorithm>
#include <utility>

#include "project/CommitContent.h"
#include "project/SharedFrame.h"

namespace usdlive::server {

namespace {

constexpr Revision kPageCommits = 256;  // commits in one read from the store

const std::string kConflation = "conflation";

}  // namespace

Catchup::Catchup(const Limits& limits, const HistoryLine& line, const HistoryStart& start,
                 SessionTable& sessions, CommitReads& reads, const Previews& previews,
                 ports::Outbox& outbox, ProjectCounters& counters)
    : limits_(limits),
      line_(line),
      start_(start),
      sessions_(sessions),
      reads_(reads),
      previews_(previews),
      outbox_(outbox),
      counters_(counters),
      recent_(limits.recentBytes) {}

Revision Catchup::Stream::next() const {
    const auto* log = std::get_if<SendingLog>(&state);
    return log ? log->next : position + 1;
}

void Catchup::Stream::moveTo(Revision revision) {
    position = revision;
    opened.erase(opened.begin(), opened.upper_bound(position));
    submitted.erase(submitted.begin(), submitted.upper_bound(position));
}

Catchup::Stream* Catchup::find(SessionId session) {
    const auto found = streams_.find(session);
    return found == streams_.end() ? nullptr : &found->second;
}

void Catchup::close(const Stream& stream, const Error& error) {
    if (Session* session = sessions_->find(stream.id)) sessions_->close(*session, error);
}

// ---- sessions

void Catchup::begin(const Session& session, Revision position) {
    Stream& stream = streams_[session.id];
    stream.id = session.id;
    stream.client = session.client;
    stream.conflates = session.features.contains(kConflation);
    stream.readsCompact = session.features.contains(kCompactFeature);
    stream.greetedAt = line_->durable();
    stream.position = position;
    pump(stream);
}

void Catchup::closing(SessionId session) {
    Stream* stream = find(session);
    if (!stream) return;
    stream->isClosing = true;
    stream->answers.clear();
    stream->sending.reset();
}

void Catchup::drained(SessionId session) {
    if (Stream* stream = find(session)) pump(*stream);
}

void Catchup::sendsLayerAsOf(SessionId session, Revision revision) {
    Stream* stream = find(session);
    if (stream && revision > stream->position) stream->opened.insert(revision);
}

void Catchup::sendPreview(const PreviewFrame& preview, const SharedBytes& frame) {
    std::optional<CompactFrame> compact;
    bool isEncoded = false;
    for (auto& [id, stream] : streams_) {
        if (!stream.isLive() || stream.client == preview.author) continue;
        if (stream.readsCompact && !std::exchange(isEncoded, true))
            compact = encodeCompact(preview, names_);
        if (stream.readsCompact && compact)
            sendCompact(stream, *compact);
        else
            outbox_->send(id, frame);
    }
}

void Catchup::sendCompact(Stream& stream, const CompactFrame& frame) {
    if (SharedBytes names = stream.names.introduce(frame))
        outbox_->send(stream.id, std::move(names));
    outbox_->send(stream.id, frame.bytes);
}

void Catchup::sendAcceptance(Stream& stream, const Acceptance& acceptance) {
    outbox_->send(stream.id, std::make_shared<const Bytes>(encodeAcceptance(acceptance)));
}

Revision Catchup::greetedAt(SessionId session) const {
    const auto found = streams_.find(session);
    return found == streams_.end() ? 0 : found->second.greetedAt;
}

std::optional<Hash> Catchup::hashAt(Revision revision) const {
    if (revision == start_->base().revision) return start_->base().hash;
    if (revision == line_->durable()) return line_->durableHash();
    const auto* recent = recent_.find(revision);
    return recent ? std::optional(recent->hash) : std::nullopt;
}

Revision Catchup::oldestNeeded(Revision newest) const {
    for (const auto& [id, stream] : streams_) {
        if (stream.isClosing) continue;
        newest = std::min({newest, stream.position, stream.next() - 1});
        for (const RequestLog& log : stream.logs) newest = std::min(newest, log.from - 1);
    }
    return newest;
}

// ---- commits that became durable

void Catchup::durable(const OrderedCommit& commit) {
    recent_.add({commit.revision, commit.broadcast, commit.hash});
    ++counters_->commits;
    counters_->edits += commit.edits;
    counters_->dropped += commit.dropped;
    if (isInParts(*commit.broadcast))
        broadcastInParts(commit);
    else
        broadcast(commit);
}

void Catchup::broadcast(const OrderedCommit& commit) {
    const auto compact = compactForm(commit);
    std::vector<SessionId> others;  // that are sent the commit as it is stored
    for (auto& [id, stream] : streams_) {
        if (!stream.isLive()) continue;
        if (outbox_->lags(id)) {
            stream.state = CatchingUp{};  // FR6
            continue;
        }
        ++counters_->delivered;
        if (stream.hasContentOf(commit))
            sendAcceptance(stream, *commit.acceptance);
        else if (stream.readsCompact && compact)
            sendCompact(stream, *compact);
        else
            others.push_back(id);
    }
    outbox_->sendCommit(others, commit.broadcast, commit.revision);
    for (auto& [id, stream] : streams_) {
        if (!stream.isLive()) continue;
        stream.moveTo(commit.revision);
        releaseAnswers(stream);
    }
}

/// Returns the commit as a compact frame (FR9); nothing if it is too large or no session reads it.
std::optional<CompactFrame> Catchup::compactForm(const OrderedCommit& commit) {
    const auto reads = [&](const auto& entry) {
        const Stream& stream = entry.second;
        return stream.readsCompact && stream.isLive() && !stream.hasContentOf(commit);
    };
    if (!commit.content || std::ranges::none_of(streams_, reads)) return std::nullopt;
    return encodeCompact(*commit.content, names_);
}

/// Sends the commit to each session as a commit of the past: in parts, as fast as the connection
/// allows.
void Catchup::broadcastInParts(const OrderedCommit& commit) {
    recent_.shareInParts(commit.revision, commit.broadcast);
    outbox_->sendCommit({}, commit.broadcast, commit.revision);
    for (auto& [id, stream] : streams_) {
        if (!stream.isLive()) continue;
        if (stream.hasContentOf(commit) && !outbox_->lags(id)) {
            sendAcceptance(stream, *commit.acceptance);
            commitSent(stream);
            continue;
        }
        stream.isAhead = outbox_->holdCommits(id);
        stream.state = CatchingUp{};
        pump(stream);
    }
}

void Catchup::becameDurable(Revision /*upTo*/) {
    for (auto& [id, stream] : streams_) pump(stream);
}

// ---- commits of the past

void Catchup::pump(Stream& stream) {
    while (!stream.isClosing && !stream.isLive() &&
           !reads_->isReading(stream.id, ReadPurpose::Stream) && !outbox_->congested(stream.id)) {
        if (stream.sending) {
            sendPart(stream);
            continue;
        }
        const auto* log = std::get_if<SendingLog>(&stream.state);
        const Revision next = stream.next();
        const Revision last = log ? log->to : line_->durable();
        if (next > last)
            log ? endLog(stream) : becomeLive(stream);
        else if (!log && next + limits_.maxBehind < last)
            return close(stream, {ErrorCode::SlowReader, "the session is too many commits behind"});
        else if (!sendRecent(stream, last))
            reads_->request(stream.id,
                            {ReadPurpose::Stream, next, std::min(last, next + kPageCommits - 1)});
    }
}

void Catchup::commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits) {
    Stream* stream = find(session);
    if (!stream || stream->isClosing) return;
    if (!commits) return close(*stream, commits.error());
    for (StoredCommit& commit : *commits) {
        if (isInParts(*commit.frame)) {
            if (const SharedBytes shared = recent_.findInParts(commit.revision))
                commit.frame = shared;
            continue;
        }
        auto stub = importStub(withoutLength(*commit.frame), commit.hash);
        if (!stub) return close(*stream, stub.error());
        if (*stub) commit.frame = std::make_shared<const Bytes>(std::move(**stub));
    }
    sendRun(*stream, *commits);
    pump(*stream);
}

void Catchup::becomeLive(Stream& stream) {
    if (!stream.logs.empty()) return beginLog(stream);
    stream.state = Live{};
    stream.isAhead = false;
    outbox_->releaseCommits(stream.id, stream.position + 1);
    previews_->forEach([&](const ClientId& author, const Previews::Preview& preview) {
        if (author != stream.client) outbox_->send(stream.id, preview.frame);
    });
}

// ---- the log

void Catchup::sendLog(Session& session, const RequestLog& request) {
    const Revision newest = line_->durable();
    const Revision to = request.to == 0 ? newest : request.to;
    if (to > newest || request.from > newest)
        return sessions_->sendError(
            session,
            {ErrorCode::FutureRevision, "the newest revision is " + std::to_string(newest)},
            request.request);
    const Revision oldest = start_->oldest();
    const Revision from = request.from == 0 ? oldest + 1 : request.from;
    if (from <= oldest || (request.to != 0 && to <= oldest))
        return sessions_->sendError(session, historyReplaced(std::min(from, to), oldest).value(),
                                    request.request);
    if (request.to != 0 && from > to)
        return sessions_->sendError(
            session,
            {ErrorCode::InvalidArgument,
             "the log cannot end at revision " + std::to_string(to) + ", before its beginning"},
            request.request);
    Stream& stream = *find(session.id);
    stream.logs.push_back({request.request, from, to});
    if (stream.isLive()) beginLog(stream);
    pump(stream);
}

void Catchup::beginLog(Stream& stream) {
    const RequestLog request = stream.logs.front();
    stream.logs.pop_front();
    if (stream.isLive()) stream.isAhead = outbox_->holdCommits(stream.id);
    stream.state = SendingLog{request.request, request.from, request.to};
    outbox_->send(stream.id, sharedFrame(LogBegin{request.request}));
}

void Catchup::endLog(Stream& stream) {
    if (const Session* session = sessions_->find(stream.id))
        sessions_->send(*session, LogEnd{std::get<SendingLog>(stream.state).request});
    stream.state = CatchingUp{};
}

// ---- answers

void Catchup::submitted(SessionId session, Revision revision) {
    Stream* stream = find(session);
    if (stream && stream->readsCompact) stream->submitted.insert(revision);
}

void Catchup::answer(SessionId session, Answer answer) {
    Stream* stream = find(session);
    if (!stream || stream->isClosing) return;
    stream->answers.add(std::move(answer));
    releaseAnswers(*stream);
}

std::map<SessionId, std::vector<std::uint64_t>> Catchup::refuse(
    const std::vector<LostSubmission>& lost, const Error& error) {
    std::map<SessionId, std::vector<std::uint64_t>> refused;
    for (auto& [id, stream] : streams_) {
        if (stream.isClosing) continue;
        stream.submitted.clear();  // their revisions are given again
        refused[id] = stream.answers.rollBack(id, lost, line_->durable(), sessions_->shown(error));
        releaseAnswers(stream);
    }
    return refused;
}

void Catchup::releaseAnswers(Stream& stream) {
    while (!stream.isClosing) {
        const auto answer = stream.answers.next(stream.position);
        if (!answer) return;
        outbox_->send(stream.id, answer->frame);
        if (!answer->closes) continue;
        if (Session* session = sessions_->find(stream.id)) sessions_->end(*session);
    }
}

}  // namespace usdlive::server
