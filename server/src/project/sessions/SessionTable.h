// All sessions of a project.
#pragma once

#include <map>
#include <optional>

#include "Wiring.h"
#include "sessions/Session.h"

namespace usdlive::server {

/// Knows who is connected, and which layers they have open. Sends control messages and closes
/// sessions.
class SessionTable {
public:
    explicit SessionTable(ports::Outbox& outbox) : outbox_(outbox) {}

    /// Notified in the order in which they are added.
    void addListener(SessionListener& listener) { listeners_.add(listener); }

    Session& add(SessionId id);
    /// Sends what is queued for the session, then closes it.
    void end(Session& session);
    /// The same, after the error that says why.
    void close(Session& session, const Error& error);
    /// The connection has ended. Returns false for an unknown session.
    bool remove(SessionId id);

    [[nodiscard]] Session* find(SessionId id);
    [[nodiscard]] const Session* find(SessionId id) const;
    /// nullptr: there is no such session, or it has no welcome yet, or is closing.
    [[nodiscard]] Session* greeted(SessionId id);
    [[nodiscard]] std::map<SessionId, Session>& all() { return sessions_; }
    [[nodiscard]] const std::map<SessionId, Session>& all() const { return sessions_; }
    [[nodiscard]] std::size_t size() const { return sessions_.size(); }
    /// Has the user a session?
    [[nodiscard]] bool isUserConnected(const UserName& user) const;
    [[nodiscard]] bool isConnected(const ClientId& client) const;

    /// False: it was open, or was not, already.
    bool open(Session& session, const LayerId& layer);
    bool closeLayer(Session& session, const LayerId& layer);
    [[nodiscard]] bool isOpen(const LayerId& layer) const;
    /// The users that have the layer open.
    [[nodiscard]] std::set<UserName> editors(const LayerId& layer) const;

    void send(const Session& session, const ControlMessage& message);
    void sendError(const Session& session, const Error& error,
                   std::optional<std::uint64_t> request = {}, std::optional<Hash> blob = {});
    /// Sends a control message to each session that has its welcome.
    void sendToAll(const ControlMessage& message);
    /// Sends the update to each session that asked for the feature.
    void sendToSubscribers(const std::string& feature, const StateUpdate& update);

private:
    Wire<ports::Outbox> outbox_;
    Listeners<SessionListener> listeners_;
    std::map<SessionId, Session> sessions_;
};

}  // namespace usdlive::server
