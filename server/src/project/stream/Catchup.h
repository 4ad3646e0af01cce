// Sends each session the commits in order: live when they become durable, or from the past.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <variant>
#include <vector>

#include "project/Project.h"
#include "project/Wiring.h"
#include "project/lines/HistoryLine.h"
#include "project/lines/HistoryStart.h"
#include "project/sessions/SessionTable.h"
#include "project/stream/Answers.h"
#include "project/stream/CommitReads.h"
#include "project/stream/Previews.h"
#include "project/stream/RecentCommits.h"

namespace usdlive::server {

/// The session is sent every commit when it becomes durable.
struct Live {};
/// The session is sent commits of the past until it has the newest one.
struct CatchingUp {};
/// The session is sent the commits [next, to] again; live ones wait.
struct SendingLog {
    std::uint64_t request = 0;
    Revision next = 0, to = 0;
};
/// A commit that is sent to a session in parts, as fast as the connection allows.
struct SendingParts {
    SharedBytes frame;
    std::size_t offset = 0;  ///< position of the next part
};

/// Sends commits to sessions. A session that resumes, requests the log or falls behind is sent
/// commits of the past, from memory or from the store, until it has caught up. Answers to its
/// transactions are sent in order with the commits.
class Catchup : public LineListener, public SessionListener {
public:
    struct Limits {
        std::size_t recentBytes = 64ull << 20;  ///< size of the commits that are kept in memory
        Revision maxBehind = 100'000;           ///< a session that lacks more commits is closed
    };
    Catchup(const Limits& limits, const HistoryLine& line, const HistoryStart& start,
            SessionTable& sessions, CommitReads& reads, const Previews& previews,
            ports::Outbox& outbox, ProjectCounters& counters);

    /// Starts to send commits to a session that was welcomed and has the commits up to `position`.
    void begin(const Session& session, Revision position);
    /// Call it when the session is no longer ports::Outbox::congested() or lags().
    void drained(SessionId session);
    /// Sends commits again, between live ones.
    void sendLog(Session& session, const RequestLog& request);
    /// Call it when a layer is sent to the session at this revision. Commits before and after it
    /// are not conflated into one (CF1).
    void sendsLayerAsOf(SessionId session, Revision revision);
    /// Sends a preview to the sessions that have caught up, except to those of its author. `frame`
    /// is the encoded preview.
    void sendPreview(const PreviewFrame& preview, const SharedBytes& frame);

    /// Call it when the transaction of the commit `revision` was received from the session. The
    /// session needs no content that it has sent itself (FR11).
    void submitted(SessionId session, Revision revision);
    /// Sends the answer when the session was sent the commits up to Answer::after.
    void answer(SessionId session, Answer answer);
    /// Refuses transactions whose commits were lost. Returns the numbers of those that each session
    /// gets a refusal for.
    std::map<SessionId, std::vector<std::uint64_t>> refuse(const std::vector<LostSubmission>& lost,
                                                           const Error& error);

    /// Returns the newest durable commit at the time of the session's welcome.
    [[nodiscard]] Revision greetedAt(SessionId session) const;
    /// Returns the hash of the chain at a revision; nothing if it is not in memory.
    [[nodiscard]] std::optional<Hash> hashAt(Revision revision) const;
    /// Returns the oldest revision after which a session still needs commits; `newest` if none
    /// does.
    [[nodiscard]] Revision oldestNeeded(Revision newest) const;

    /// Receives the result of a read of CommitReads.
    void commitsRead(SessionId session, Result<std::vector<StoredCommit>> commits);

    void durable(const OrderedCommit& commit) override;
    void becameDurable(Revision upTo) override;
    void closing(SessionId session) override;
    void left(const Session& session) override { streams_.erase(session.id); }

private:
    struct Stream {
        SessionId id = 0;
        ClientId client;
        bool conflates = false, readsCompact = false;  ///< features
        bool isClosing = false;
        std::variant<Live, CatchingUp, SendingLog> state = CatchingUp{};
        Revision greetedAt = 0;  ///< newest durable commit at the welcome
        Revision position = 0;   ///< the commits up to this one were sent
        bool isAhead = false;    ///< it may have received later ones (DD6)
        /// The revisions at which layers were sent. A conflated commit must end there (CF1).
        std::set<Revision> opened;
        /// The revisions of its own transactions that were not sent yet.
        std::set<Revision> submitted;
        KnownNames names;             ///< the numbers of names that it was told (FR10)
        std::deque<RequestLog> logs;  ///< waiting requests
        std::optional<SendingParts> sending;
        Answers answers;

        [[nodiscard]] bool isLive() const {
            return !isClosing && std::holds_alternative<Live>(state);
        }
        /// While a commit is sent in parts, later commits wait.
        [[nodiscard]] bool canSend() const { return !isClosing && !sending; }
        [[nodiscard]] Revision next() const;
        /// Returns whether the session has sent the content of the commit itself.
        [[nodiscard]] bool hasContentOf(const OrderedCommit& commit) const {
            return readsCompact && commit.acceptance && submitted.contains(commit.revision);
        }
        void moveTo(Revision revision);
    };

    [[nodiscard]] Stream* find(SessionId session);
    void close(const Stream& stream, const Error& error);
    void broadcast(const OrderedCommit& commit);
    [[nodiscard]] std::optional<CompactFrame> compactForm(const OrderedCommit& commit);
    void sendCompact(Stream& stream, const CompactFrame& frame);
    void sendAcceptance(Stream& stream, const Acceptance& acceptance);
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
    NameNumbers names_;                    ///< in the compact frames of all sessions
    std::map<SessionId, Stream> streams_;  ///< streams of sessions that were welcomed
};

}  // namespace usdlive::server
