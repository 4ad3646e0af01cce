// Keeps the sessions and sends control messages to them.
#include "sessions/SessionTable.h"

#include <algorithm>

#include "usdlive/server/project/SharedFrame.h"

namespace usdlive::server {

Session& SessionTable::add(SessionId id) {
    Session& session = sessions_[id];
    session.id = id;
    return session;
}

void SessionTable::end(Session& session) {
    outbox_->close(session.id);
    session.phase = Closing{};
    listeners_.notify(&SessionListener::closing, session.id);
}

void SessionTable::close(Session& session, const Error& error) {
    send(session, ErrorMessage{std::string(errorName(error.code)), error.message, true, {}, {}});
    end(session);
}

bool SessionTable::remove(SessionId id) {
    const auto left = sessions_.extract(id);
    if (left.empty()) return false;
    listeners_.notify(&SessionListener::left, left.mapped());
    for (const LayerId& layer : left.mapped().open)
        listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

Session* SessionTable::find(SessionId id) {
    const auto found = sessions_.find(id);
    return found == sessions_.end() ? nullptr : &found->second;
}

const Session* SessionTable::find(SessionId id) const {
    const auto found = sessions_.find(id);
    return found == sessions_.end() ? nullptr : &found->second;
}

Session* SessionTable::greeted(SessionId id) {
    Session* session = find(id);
    return session && session->isGreeted() ? session : nullptr;
}

bool SessionTable::isUserConnected(const UserName& user) const {
    return std::ranges::any_of(sessions_, [&](const auto& one) {
        return one.second.isGreeted() && one.second.subject.user == user;
    });
}

bool SessionTable::isConnected(const ClientId& client) const {
    return std::ranges::any_of(sessions_,
                               [&](const auto& one) { return one.second.client == client; });
}

bool SessionTable::open(Session& session, const LayerId& layer) {
    if (!session.open.insert(layer).second) return false;
    listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

bool SessionTable::closeLayer(Session& session, const LayerId& layer) {
    if (session.open.erase(layer) == 0) return false;
    listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

bool SessionTable::isOpen(const LayerId& layer) const {
    return std::ranges::any_of(sessions_,
                               [&](const auto& one) { return one.second.open.contains(layer); });
}

std::set<UserName> SessionTable::editors(const LayerId& layer) const {
    std::set<UserName> editors;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.open.contains(layer))
            editors.insert(session.subject.user);
    return editors;
}

void SessionTable::send(const Session& session, const ControlMessage& message) {
    outbox_->send(session.id, sharedFrame(message));
}

void SessionTable::sendError(const Session& session, const Error& error,
                             std::optional<std::uint64_t> request, std::optional<Hash> blob) {
    send(session,
         ErrorMessage{std::string(errorName(error.code)), error.message, false, request, blob});
}

void SessionTable::sendToAll(const ControlMessage& message) {
    const SharedBytes frame = sharedFrame(message);
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted()) outbox_->send(id, frame);
}

void SessionTable::sendToSubscribers(const std::string& feature, const StateUpdate& update) {
    std::vector<SessionId> listening;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.features.contains(feature)) listening.push_back(id);
    outbox_->sendUpdate(listening, update);
}

}  // namespace usdlive::server
