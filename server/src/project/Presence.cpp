// Where everybody is (PS1-PS3): passed on in sweeps, so that it costs a frame for each listener
// however many move; never stored.
#include <utility>

#include "ProjectImpl.h"

namespace usdlive::server {

namespace {

const std::string kPresenceFeature = "presence";
constexpr std::size_t kMaxPresenceBytes = 64 * 1024;
constexpr std::size_t kMatrix = 16;

}  // namespace

void Project::Impl::showPresence(Session& session, Presence presence) {
    if (!presence.camera.empty() && presence.camera.size() != kMatrix)
        return close(session, {ErrorCode::MalformedControl, "a camera is a matrix of 16 numbers"});
    presence.client = session.client;
    presence.user = session.subject.user;
    presence.application = session.application;
    session.heard = true;
    if (session.presence == presence) return;
    const std::size_t bytes = encodeControl(ShowPresence{presence}).size();
    if (bytes > kMaxPresenceBytes)
        return sendError(session, {ErrorCode::TransactionTooLarge,
                                   "a presence of " + std::to_string(bytes) + " bytes"});
    if (!session.presence) ++presences_;
    session.presence = std::move(presence);
    session.shown = false;
}

void Project::Impl::sweep(std::int64_t nowMs) {
    Presences message;
    for (auto& [id, session] : sessions_) {
        if (!session.presence) continue;
        if (std::exchange(session.heard, false)) session.heardMs = nowMs;
        if (nowMs - session.heardMs >= kPresenceTimeMs) {
            message.gone.push_back(session.client);
            session.presence.reset();
            --presences_;
        } else if (!session.shown) {
            session.shown = true;
            message.shown.push_back(*session.presence);
        }
    }
    if (message.shown.empty() && message.gone.empty()) return;
    tellAll(kPresenceFeature, message);
}

void Project::Impl::tellPresencesTo(Session& session) {
    if (!session.features.contains(kPresenceFeature)) return;
    Presences message;
    for (const auto& [id, other] : sessions_)
        if (other.presence && id != session.id) message.shown.push_back(*other.presence);
    ports_.outbox.tellFirst(session.id, message);
}

/// Of a session that has ended.
void Project::Impl::presenceLeft(const ClientId& client) {
    --presences_;
    tellAll(kPresenceFeature, Presences{{}, {client}});
}

}  // namespace usdlive::server
