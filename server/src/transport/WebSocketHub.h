#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>

#include "Socket.h"
#include "usdlive/server/transport/WebSocketTransport.h"

namespace usdlive::server {

class WebSocketSession;

/// What sessions know of the transport they belong to. It abandons them when it goes; operations
/// that end after that do not call it any more.
class WebSocketHub {
public:
    boost::asio::io_context& io;
    const WebSocketOptions options;
    SessionHandler& handler;
    const Background background;
    Log& log;
    TransportCounters counters;

    /// Calls the session's flush() at the end of the event loop's turn.
    virtual void flushLater(std::shared_ptr<WebSocketSession> session) = 0;
    /// Tells the handler that the session is closed, later in this turn.
    virtual void tellClosed(SessionId session) = 0;
    /// The session's socket is closed. The hub forgets the session.
    virtual void finished(WebSocketSession& session) = 0;

protected:
    WebSocketHub(boost::asio::io_context& io, WebSocketOptions options, SessionHandler& handler,
                 Background background, Log& log)
        : io(io), options(options), handler(handler), background(std::move(background)), log(log) {}
    ~WebSocketHub() = default;
};

}  // namespace usdlive::server
