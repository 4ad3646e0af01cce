// Commits of the past for sessions that resume or ask for the log, until they have caught up.
#include "ProjectImpl.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

namespace {

constexpr Revision kPageCommits = 256;  // read from the store at once
constexpr std::size_t kMaxLogs = 16;    // asked for by one session and not begun

ByteView withoutLength(const SharedBytes& frame) {
    return ByteView(*frame).subspan(sizeof(std::uint32_t));
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
           !host_.congested(session.id)) {
        const auto* log = std::get_if<SendingLog>(&session.stream);
        const Revision next = log ? log->next : session.position + 1;
        const Revision last = log ? log->to : durable_;
        if (next > last)
            log ? endLog(session) : becomeLive(session);
        else if (const auto* recent = recent_.find(next))
            sendPast(session, recent->frame);
        else
            requestRead(session,
                        {ReadPurpose::Stream, next, std::min(last, next + kPageCommits - 1)});
    }
}

void Project::Impl::sendPast(Session& session, const SharedBytes& frame) {
    host_.send(session.id, frame);
    ++counters_.delivered;
    if (auto* log = std::get_if<SendingLog>(&session.stream)) {
        ++log->next;
        return;
    }
    ++session.position;
    releaseAnswers(session);
}

void Project::Impl::becomeLive(Session& session) {
    if (!session.logs.empty()) return beginLog(session);
    session.stream = Live{};
    previews_.forEach([&](const ClientId& author, const SharedBytes& frame) {
        if (author != session.client) host_.send(session.id, frame);
    });
}

void Project::Impl::requestLog(Session& session, const RequestLog& request) {
    const Revision to = request.to == 0 ? durable_ : request.to;
    if (to > durable_ || request.from > durable_)
        return sendError(
            session,
            {ErrorCode::FutureRevision, "the newest revision is " + std::to_string(durable_)},
            request.request);
    if (session.logs.size() >= kMaxLogs)
        return close(session, {ErrorCode::MalformedControl, "too many requests at once"});
    session.logs.push_back({request.request, std::max<Revision>(request.from, 1), to});
    if (session.isLive()) beginLog(session);
    pump(session);
}

void Project::Impl::beginLog(Session& session) {
    const RequestLog request = session.logs.front();
    session.logs.pop_front();
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
        host_.send(session.id, answer.frame);
        if (!answer.closing) continue;
        host_.close(session.id);
        session.phase = Closing{};
    }
}

std::optional<Hash> Project::Impl::knownHash(Revision revision) const {
    if (revision == 0) return Hash{};
    if (revision == durable_) return durableHash_;
    const auto* recent = recent_.find(revision);
    return recent ? std::optional(recent->hash) : std::nullopt;
}

void Project::Impl::requestRead(Session& session, Read read) {
    session.reads.push_back(read);
    if (session.reads.size() == 1) host_.readCommits(session.id, read.from, read.to);
}

void Project::Impl::commitsRead(SessionId id, Result<std::vector<StoredCommit>> commits) {
    Session* session = find(id);
    if (!session || session->reads.empty()) return;
    const Read read = session->reads.front();
    session->reads.pop_front();
    if (!session->reads.empty())
        host_.readCommits(id, session->reads.front().from, session->reads.front().to);
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
    for (const StoredCommit& commit : *commits) {
        if (!session.isGreeted()) return;  // an answer on the way closed it
        auto stub = importStub(withoutLength(commit.frame), commit.hash);
        if (!stub) return close(session, stub.error());
        sendPast(session, *stub ? std::make_shared<const Bytes>(std::move(**stub)) : commit.frame);
    }
    pump(session);
}

}  // namespace usdlive::server
