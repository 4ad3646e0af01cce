// The handshake of a session: hello, resuming (SE2), welcome.
#pragma once

#include <optional>

#include "Wiring.h"
#include "access/AccessPolicy.h"
#include "clients/Authors.h"
#include "layers/StateBoard.h"
#include "lines/HistoryStart.h"
#include "sessions/PresenceBoard.h"
#include "stream/Catchup.h"
#include "stream/Gestures.h"

namespace usdlive::server {

/// Answers hellos. A session that wants to resume waits until the store has said what its client
/// has committed, and that the client's history is the server's.
class Greeting {
public:
    /// Receives the frames that came before the welcome, once that was sent.
    class Receiver {
    public:
        virtual ~Receiver() = default;
        virtual void receiveFrame(SessionId session, ByteView frame) = 0;
    };
    struct Parts {
        const HistoryLine& line;
        const HistoryStart& start;
        const StoreCondition& store;
        SessionTable& sessions;
        Authors& authors;
        const LayerTable& layers;
        StateBoard& states;
        PresenceBoard& presences;
        CommitReads& reads;
        Catchup& catchup;
        Gestures& gestures;
        const AccessPolicy& access;
        ports::Activity& activity;
        Receiver& receiver;
    };
    Greeting(const Project::Options& options, const Parts& parts);

    void greet(Session& session, const Hello& hello);
    /// Keeps a frame until the welcome. False: the session does not wait for it.
    bool hold(Session& session, ByteView frame);
    /// Goes on with a session that wants to resume, after its client's record was read.
    void checkResume(Session& session);
    /// The store has read the commit of the revision that the session wants to resume at.
    void resumeRead(SessionId session, const Result<std::vector<StoredCommit>>& commits);

    /// The oldest revision that a session wants to resume at; `newest` if none does.
    [[nodiscard]] Revision oldestNeeded(Revision newest) const;

private:
    [[nodiscard]] std::optional<Error> whyNotResumable(const Session& session,
                                                       const Hello::Resume& resume) const;
    void supersede(const ClientId& client);
    void resumeChecked(Session& session, const Result<Hash>& hash);
    void welcome(Session& session, std::optional<Error> whyNotResumed);
    void sendWelcome(const Session& session, const Hello& hello, bool resumed);

    Wire<const Project::Options> options_;
    Wire<const HistoryLine> line_;
    Wire<const HistoryStart> start_;
    Wire<const StoreCondition> store_;
    Wire<SessionTable> sessions_;
    Wire<Authors> authors_;
    Wire<const LayerTable> layers_;
    Wire<StateBoard> states_;
    Wire<PresenceBoard> presences_;
    Wire<CommitReads> reads_;
    Wire<Catchup> catchup_;
    Wire<Gestures> gestures_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Activity> activity_;
    Wire<Receiver> receiver_;
};

}  // namespace usdlive::server
