// The handshake of a session: hello, resuming (SE2) and welcome.
#pragma once

#include <optional>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/clients/Authors.h"
#include "project/layers/LayerLists.h"
#include "project/layers/StateBoard.h"
#include "project/lines/HistoryStart.h"
#include "project/sessions/PresenceBoard.h"
#include "project/stream/Catchup.h"
#include "project/stream/Gestures.h"

namespace usdlive::server {

/// Answers hello messages. A session that resumes waits until the store has returned the client's
/// transactions, and until the client's history is known to be that of the server.
class Greeting {
public:
    /// Receives the frames that arrived before the welcome, after the welcome was sent.
    class Receiver {
    public:
        virtual ~Receiver() = default;
        virtual void receiveFrame(SessionId session, ByteView frame) = 0;
    };
    struct Parts {
        const StoreId& identity;
        const HistoryLine& line;
        const HistoryStart& start;
        const StoreCondition& store;
        SessionTable& sessions;
        Authors& authors;
        const LayerTable& layers;
        LayerLists& layerLists;
        StateBoard& states;
        PresenceBoard& presences;
        CommitReads& reads;
        Catchup& catchup;
        Gestures& gestures;
        const AccessPolicy& access;
        const ports::Outbox& outbox;
        ports::Activity& activity;
        Receiver& receiver;
    };
    Greeting(const Project::Options& options, const Parts& parts);

    void greet(Session& session, const Hello& hello);
    /// Keeps a frame until the welcome is sent. Returns false if the session is not waiting for it.
    bool hold(Session& session, ByteView frame);
    /// Continues to resume the session, after the record of its client was read.
    void checkResume(Session& session);
    /// Receives the commit at which the session resumes, read from the store.
    void resumeRead(SessionId session, const Result<std::vector<StoredCommit>>& commits);

    /// Notes more layers that a resumed session has open.
    void keepOpen(Session& session, const std::vector<LayerId>& layers);
    /// Returns the oldest revision at which a session is resuming; `newest` if none is.
    [[nodiscard]] Revision oldestNeeded(Revision newest) const;

private:
    [[nodiscard]] std::optional<Error> otherHistory(const Hello::Resume& resume) const;
    [[nodiscard]] std::optional<Error> whyForgotten(const Session& session,
                                                    const Hello::Resume& resume) const;
    [[nodiscard]] std::optional<Error> whyNotResumable(const Session& session,
                                                       const Hello::Resume& resume) const;
    [[nodiscard]] std::vector<std::string> features(SessionId session, const Hello& hello) const;
    /// AC9, AC10: returns why the user may not have a session with this client id.
    [[nodiscard]] std::optional<Error> whyNotAs(const Session& session,
                                                const ClientId& client) const;
    void supersede(const ClientId& client);
    void resumeChecked(Session& session, const Result<Hash>& hash);
    void welcome(Session& session, std::optional<Error> whyNotResumed);
    void sendWelcome(const Session& session, const Hello& hello, bool resumed);

    Wire<const Project::Options> options_;
    Wire<const StoreId> identity_;
    Wire<const HistoryLine> line_;
    Wire<const HistoryStart> start_;
    Wire<const StoreCondition> store_;
    Wire<SessionTable> sessions_;
    Wire<Authors> authors_;
    Wire<const LayerTable> layers_;
    Wire<LayerLists> layerLists_;
    Wire<StateBoard> states_;
    Wire<PresenceBoard> presences_;
    Wire<CommitReads> reads_;
    Wire<Catchup> catchup_;
    Wire<Gestures> gestures_;
    Wire<const AccessPolicy> access_;
    Wire<const ports::Outbox> outbox_;
    Wire<ports::Activity> activity_;
    Wire<Receiver> receiver_;
};

}  // namespace usdlive::server
