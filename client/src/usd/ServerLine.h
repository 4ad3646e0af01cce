// A client's connection to the server, between the session and the transport.
#pragma once

#include <memory>
#include <optional>

#include "session/Session.h"
#include "transport/Connection.h"

namespace usdlive::client {

/// Hands what a connection brings to the session, and remembers why it was lost or refused. One
/// thread; the network has a thread of its own.
class ServerLine {
public:
    explicit ServerLine(std::unique_ptr<Connection> connection)
        : connection_(std::move(connection)) {}

    [[nodiscard]] Connection& connection() { return *connection_; }
    /// Hands all that has arrived, up to a bound, to the session.
    void receive(Session& session);
    /// The server has welcomed the session.
    void welcomed() { refusal_.reset(); }
    /// The server, or the session that could not read it, ends this connection. False: every
    /// attempt to connect ends with this same message, which was reported before.
    [[nodiscard]] bool closing(const ErrorMessage& message, Session& session);

    [[nodiscard]] bool isOpen() const { return open_; }
    [[nodiscard]] const std::optional<Error>& lastLoss() const { return lastLoss_; }
    /// Why the server does not take this client at all.
    [[nodiscard]] const std::optional<Error>& refused() const { return refused_; }
    [[nodiscard]] Error notThere() const {
        return lastLoss_.value_or(Error{ErrorCode::NotConnected, "the server did not answer"});
    }

private:
    void take(Connection::Opened&, Session& session);
    void take(Connection::Message& message, Session& session);
    void take(Connection::Lost& lost, Session& session);
    void hangUp(Error reason, Session& session);

    const std::unique_ptr<Connection> connection_;
    bool open_ = false;  // as far as receive() knows
    std::optional<Error> lastLoss_;
    std::optional<ErrorMessage> refusal_;  // that ended the last connection
    std::optional<Error> refused_;
};

}  // namespace usdlive::client
