// The default implementations of a Transport, which send to each session individually.
#include "transport/Transport.h"

namespace usdlive::server {

void Transport::sendCommit(std::span<const SessionId> sessions, SharedBytes frame, Revision) {
    for (const SessionId session : sessions) send(session, frame);
}

void Transport::sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) {
    if (sessions.empty()) return;
    const SharedBytes frame = encodeStateUpdate(update);
    for (const SessionId session : sessions) send(session, frame);
}

void Transport::sendInitialState(SessionId session, const StateUpdate& all) {
    if (SharedBytes frame = encodeStateUpdate(all)) send(session, std::move(frame));
}

}  // namespace usdlive::server
