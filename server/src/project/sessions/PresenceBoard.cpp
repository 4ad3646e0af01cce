// Receives presences and forwards them in sweeps.
#include "project/sessions/PresenceBoard.h"

#include <iterator>
#include <utility>

#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::server {

namespace {

const std::string kPresenceFeature = "presence";

}  // namespace

void PresenceBoard::show(Session& session, Presence presence) {
    presence.client = session.client;
    presence.user = session.subject.user;
    presence.application = session.application;
    const auto known = shown_.find(session.id);
    if (known != shown_.end()) known->second.isFresh = true;
    if (known != shown_.end() && known->second.presence == presence) return;
    if (const auto valid = checkPresence(presence); !valid)
        return sessions_->sendError(session, valid.error());
    Shown& shown = shown_[session.id];
    shown.presence = std::move(presence);
    shown.isPassedOn = false;
}

void PresenceBoard::sweep(std::int64_t nowMs) {
    Presences message;
    for (auto entry = shown_.begin(); entry != shown_.end();) {
        Shown& shown = entry->second;
        if (std::exchange(shown.isFresh, false)) shown.freshMs = nowMs;
        const bool isExpired = nowMs - shown.freshMs >= kPresenceTimeMs;
        if (isExpired)
            message.gone.push_back(shown.presence.client);
        else if (!std::exchange(shown.isPassedOn, true))
            message.shown.push_back(shown.presence);
        entry = isExpired ? shown_.erase(entry) : std::next(entry);
    }
    if (message.shown.empty() && message.gone.empty()) return;
    sessions_->sendToSubscribers(kPresenceFeature, message);
}

void PresenceBoard::sendAllTo(const Session& session) {
    if (!session.features.contains(kPresenceFeature)) return;
    Presences message;
    for (const auto& [id, other] : shown_)
        if (id != session.id) message.shown.push_back(other.presence);
    outbox_->sendInitialState(session.id, message);
}

void PresenceBoard::left(const Session& session) {
    if (shown_.erase(session.id) == 0) return;
    sessions_->sendToSubscribers(kPresenceFeature, Presences{{}, {session.client}});
}

}  // namespace usdlive::server
