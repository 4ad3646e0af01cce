// Sends each session the commits, in order: as they become durable, or from the past.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <variant>
#include <vector>

#include "Wiring.h"
#include "lines/HistoryLine.h"
#include "lines/HistoryStart.h"
#include "sessions/SessionTable.h"
#include "stream/Answers.h"
#include "stream/CommitReads.h"
#include "stream/Previews.h"
#include "stream/RecentCommits.h"
#include "usdlive/server/project/Project.h"

namespace usdlive::server {

/// Gets every commit as it becomes durable.
struct Live {};
/// Gets commits of the past until it has reached the newest.
struct CatchingUp {};
/// Gets the commits [next, to] again; live ones wait until it has them.
struct SendingLog {
    std::uint64_t request = 0;
    Revision next = 0, to = 0;
};
/// A commit in parts on its way to a session, as far as the connection takes it.
struct SendingParts {
    SharedBytes frame;
    std::size_t offset = 0;  ///< of the part that is next
};

/// Sends commits to sessions. A session that resumes, asks for the log or falls behind gets commits
/// of the past, from memory or from the store, until it has caught up. Answers to its transactions
/// keep their place among the commits.
class Catchup : public LineListener, public SessionListener {
public:
    struct Limits {
        std::size_t recentBytes = 64ull << 20;  ///< of commits kept in memory
        Revision maxBehind = 100'000;           ///< a session that lags by more is closed
    };
    Catchup(const Limits& limits, const HistoryLine& line, const HistoryStart& start,
            SessionTable& sessions, CommitReads& reads, const Previews& previews,
            ports::Outbox& outbox, ProjectCounters& counters);

    /// The session has got its welcome, and has the commits up to `position`.
    void begin(const Session& session, Revision position);
    /// The session is no longer ports::Outbox::congested().
    void drained(SessionId session);
    /// Sends commits once more, between live ones.
    void sendLog(Session& session, const RequestLog& request);
    /// A layer is sent to the session as of this revision. Commits are not conflated over it (CF1).
    void sendsLayerAsOf(SessionId session, Revision revision);
    /// Sends a frame to the sessions that have caught up, but not to this client's.
    void sendToLive(const SharedBytes& frame, const ClientId& except);

    /// Sends the answer when the session has the commits that it follows.
    void answer(SessionId session, Answer answer);
    /// These transactions are refused, instead of being committed.
    void refuse(const std::vector<LostSubmission>& lost, const Error& error);

    /// The newest durable commit when the session got its welcome.
    [[nodiscard]] Revision greetedAt(SessionId session) const;
    /// The chain hash at a revision; nothing: it is not in memory.
    [[nodiscard]] std::optional<Hash> hashAt(Revision revision) const;
    [[nodiscard]] Revision newestInParts() const { return recent_.newestInParts(); }
    /// The oldest revision whose following commits some session still has to be sent; `newest` if
    /// none has.
    [[nodiscard]] Revision oldestNeeded(Revision newest) const;

    /// An answer of CommitReads.
    void commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits);

    void durable(const OrderedCommit& commit) override;
    void becameDurable(Revision upTo) override;
    void closing(SessionId session) override;
    void left(const Session& session) override { streams_.erase(session.id); }

private:
    struct Stream {
        SessionId id = 0;
        ClientId client;
        bool conflates = false, readsParts = false;  ///< features
        bool isClosing = false;
        std::variant<Live, CatchingUp, SendingLog> state = CatchingUp{};
        Revision greetedAt = 0;  ///< the newest durable commit then
        Revision position = 0;   ///< commits up to this one were sent
        bool isAhead = false;    ///< it may have later ones (DD6)
        /// Layers were sent as of these revisions, at which what is conflated has to end (CF1).
        std::set<Revision> opened;
        std::deque<RequestLog> logs;  ///< asked for and not begun
        std::optional<SendingParts> sending;
        Answers answers;

        [[nodiscard]] bool isLive() const {
            return !isClosing && std::holds_alternative<Live>(state);
        }
        /// Commits behind one in parts are sent when all of that is.
        [[nodiscard]] bool canSend() const { return !isClosing && !sending; }
        [[nodiscard]] Revision next() const;
    };

    [[nodiscard]] Stream* find(SessionId session);
    void close(const Stream& stream, const Error& error);
    void broadcast(const OrderedCommit& commit);
    void broadcastInParts(const OrderedCommit& commit);
    void pump(Stream& stream);
    void becomeLive(Stream& stream);
    void beginLog(Stream& stream);
    void endLog(Stream& stream);
    void releaseAnswers(Stream& stream);
    // CatchupRuns.cpp
    bool sendRecent(Stream& stream, Revision last);
    void sendRun(Stream& stream, const std::vector<StoredCommit>& commits);
    [[nodiscard]] static std::optional<CommitFrame> conflatable(const Stream& stream,
                                                                const StoredCommit& stored);
    void sendPast(Stream& stream, const SharedBytes& frame);
    void sendPart(Stream& stream);
    void commitSent(Stream& stream);

    Limits limits_;
    Wire<const HistoryLine> line_;
    Wire<const HistoryStart> start_;
    Wire<SessionTable> sessions_;
    Wire<CommitReads> reads_;
    Wire<const Previews> previews_;
    Wire<ports::Outbox> outbox_;
    Wire<ProjectCounters> counters_;
    RecentCommits recent_;
    std::map<SessionId, Stream> streams_;  ///< of sessions that have got their welcome
};

}  // namespace usdlive::server
