// The default implementations of a Transport, which send to each session individually.
#include "usdlive/server/transport/Transport.h"

namespace usdlive::server {

void Transport::sendCommit(std::span<const SessionId> sessions, SharedBytes frame, Revision) {
    for (const SessionId session : sessions) send(session, frame);
}

void Transport::tell(std::span<const SessionId> sessions, const News& news) {
    if (sessions.empty()) return;
    const SharedBytes frame = encodeNews(news);
    for (const SessionId session : sessions) send(session, frame);
}

void Transport::tellFirst(SessionId session, const News& all) {
    if (SharedBytes frame = encodeNews(all)) send(session, std::move(frame));
}

}  // namespace usdlive::server
