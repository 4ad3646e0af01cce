// The connection of a client to the server, between the session and the transport.
#pragma once

#include <memory>
#include <optional>

#include "session/Session.h"
#include "transport/Connection.h"

namespace usdlive::client {

/// Passes the messages of a connection to the session, and keeps the reason why it was lost or
/// refused. Used by one thread; the network has a thread of its own.
class ServerLink {
public:
    explicit ServerLink(std::unique_ptr<Connection> connection)
        : connection_(std::move(connection)) {}

    [[nodiscard]] Connection& connection() { return *connection_; }
    /// Passes the received messages to the session, up to a limit.
    void receive(Session& session);
    /// Call it when the server has welcomed the session.
    void welcomed(const Welcome& welcome) {
        refusal_.reset();
        if (welcome.store) connection_->prefer(*welcome.store);
    }
    /// Call it when the server ends the connection, or the session because it cannot read a
    /// message. Returns false if the last connection ended with the same message, which was then
    /// reported already.
    [[nodiscard]] bool closing(const ErrorMessage& message, Session& session);

    [[nodiscard]] bool isOpen() const { return open_; }
    [[nodiscard]] const std::optional<Error>& lastLoss() const { return lastLoss_; }
    /// Returns the reason if the server refuses this client permanently.
    [[nodiscard]] const std::optional<Error>& refused() const { return refused_; }
    /// Returns why the session has no connection.
    [[nodiscard]] Error notThere(const Session& session) const {
        if (session.otherHistory()) return session.otherHistory()->reason;
        return lastLoss_.value_or(Error{ErrorCode::NotConnected, "the server did not answer"});
    }

private:
    void take(Connection::Opened&, Session& session);
    void take(Connection::Message& message, Session& session);
    void take(Connection::Lost& lost, Session& session);
    void hangUp(Error reason, Session& session);

    const std::unique_ptr<Connection> connection_;
    bool open_ = false;  // set by receive()
    std::optional<Error> lastLoss_;
    std::optional<ErrorMessage> refusal_;  // the message that ended the last connection
    std::optional<Error> refused_;
};

}  // namespace usdlive::client
