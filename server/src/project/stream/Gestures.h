// Previews of gestures in progress (M11).
#pragma once

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/lines/HistoryLine.h"
#include "project/sessions/SessionTable.h"
#include "project/stream/Catchup.h"
#include "project/stream/Previews.h"

namespace usdlive::server {

/// Forwards previews at once, and keeps the newest one of each gesture until the gesture ends.
class Gestures : public LineListener, public SessionListener {
public:
    Gestures(Previews& previews, const HistoryLine& line, SessionTable& sessions, Catchup& catchup,
             const AccessPolicy& access, ports::Outbox& outbox, ProjectCounters& counters)
        : previews_(previews),
          line_(line),
          sessions_(sessions),
          catchup_(catchup),
          access_(access),
          outbox_(outbox),
          counters_(counters) {}

    void receive(Session& session, PreviewFrame preview, std::size_t bytes);
    /// Call it when the gesture's transaction was refused. Withdraws its preview from the other
    /// sessions.
    void refused(const ClientId& author, std::uint64_t gesture);
    void withdrawAll(const ClientId& author);

    void durable(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void left(const Session& session) override;

private:
    void withdraw(const ClientId& author, std::uint64_t gesture);

    Wire<Previews> previews_;
    Wire<const HistoryLine> line_;
    Wire<SessionTable> sessions_;
    Wire<Catchup> catchup_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Outbox> outbox_;
    Wire<ProjectCounters> counters_;
};

}  // namespace usdlive::server
