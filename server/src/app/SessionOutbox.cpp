// Passes a project's messages to its transports.
#include "app/SessionOutbox.h"

#include <memory>
#include <utility>

#include "project/SharedFrame.h"
#include "usdlive/common/protocol/Snapshot.h"

namespace usdlive::server {

void SessionOutbox::send(SessionId session, SharedBytes frames) {
    transports_.of(session).send(session, std::move(frames));
}

/// Calls `each(Transport&, its sessions)` for each transport, also for one without sessions. The
/// ids are sorted, so that the sessions of a transport are adjacent.
template <class Each>
void SessionOutbox::forTransports(std::span<const SessionId> sessions, Each each) {
    transports_.forEach([&](Transport& transport) {
        std::size_t count = 0;
        while (count < sessions.size() && carrierOf(sessions[count]) == transport.carrier())
            ++count;
        each(transport, sessions.first(count));
        sessions = sessions.subspan(count);
    });
}

void SessionOutbox::sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                               Revision revision) {
    forTransports(sessions, [&](Transport& transport, std::span<const SessionId> its) {
        transport.sendCommit(its, frame, revision);
    });
}

void SessionOutbox::sendUpdate(std::span<const SessionId> sessions, const StateUpdate& update) {
    forTransports(sessions, [&](Transport& transport, std::span<const SessionId> its) {
        transport.sendUpdate(its, update);
    });
}

void SessionOutbox::sendInitialState(SessionId session, const StateUpdate& all) {
    transports_.of(session).sendInitialState(session, all);
}

bool SessionOutbox::holdCommits(SessionId session) {
    return transports_.of(session).holdCommits(session);
}

void SessionOutbox::releaseCommits(SessionId session, Revision next) {
    transports_.of(session).releaseCommits(session, next);
}

bool SessionOutbox::congested(SessionId session) {
    return transports_.of(session).congested(session);
}

bool SessionOutbox::lags(SessionId session) { return transports_.of(session).lags(session); }

void SessionOutbox::close(SessionId session) { transports_.of(session).close(session); }

void SessionOutbox::closeAll(const Error& why) {
    transports_.forEach([&](Transport& transport) { transport.closeAll(why); });
}

void SessionOutbox::sendSnapshot(SessionId session, std::uint64_t request, LayerDoc doc) {
    auto encoder = std::make_shared<SnapshotEncoder>(std::move(doc), request);
    transports_.of(session).sendBeside(session, [encoder](std::size_t most) -> SharedBytes {
        const auto frame = encoder->next(most);
        return frame ? sharedFrame(*frame) : nullptr;
    });
}

void SessionOutbox::sendBeside(SessionId session, std::vector<SharedBytes> frames) {
    transports_.of(session).sendBeside(
        session,
        [frames = std::move(frames), next = std::size_t(0)](std::size_t) mutable -> SharedBytes {
            return next < frames.size() ? frames[next++] : nullptr;
        });
}

}  // namespace usdlive::server
