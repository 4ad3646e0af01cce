#pragma once

#include <boost/asio/basic_stream_socket.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <memory>
#include <string>

#include "usdlive/server/transport/WebSocketServer.h"

namespace usdlive::server {

using Socket =
    boost::asio::basic_stream_socket<boost::asio::ip::tcp, boost::asio::io_context::executor_type>;
using TimePoint = std::chrono::steady_clock::time_point;

struct Upgrade;  // Upgrade.h
class HttpConnection;
class WebSocketSession;

/// What connections know of the server they belong to. It abandons them when it goes; what is left
/// of them then, operations under way that end, does not call it any more.
class Hub {
public:
    boost::asio::io_context& io;
    const WebSocketServerOptions options;
    SessionHandler& handler;
    const HttpRoutes routes;
    const Background background;
    Log& log;
    TransportCounters counters;

    /// A connection has answered, or could not.
    virtual void finished(HttpConnection& connection) = 0;
    /// It asked for a session; the connection is finished with it.
    virtual void upgrade(HttpConnection& connection, Socket socket,
                         std::unique_ptr<Upgrade> upgrade) = 0;

    /// Calls flush() of it when the turn or the flush interval is over.
    virtual void flushLater(std::shared_ptr<WebSocketSession> session) = 0;
    /// Tells the handler that the session is closed, later in this turn.
    virtual void tellClosed(SessionId session) = 0;
    /// Its socket is closed; it is forgotten.
    virtual void finished(WebSocketSession& session) = 0;

protected:
    Hub(boost::asio::io_context& io, WebSocketServerOptions options, SessionHandler& handler,
        HttpRoutes routes, Background background, Log& log)
        : io(io),
          options(std::move(options)),
          handler(handler),
          routes(std::move(routes)),
          background(std::move(background)),
          log(log) {}
    ~Hub() = default;
};

}  // namespace usdlive::server
