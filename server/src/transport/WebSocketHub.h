// The part of the transport that WebSocket sessions share.
#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>

#include "transport/SessionCore.h"
#include "transport/Timer.h"
#include "transport/WebSocketTransport.h"

namespace usdlive::server {

class WebSocketSession;

/// The part of the transport that sessions use. Its destructor abandons them; operations that end
/// later do not call it any more.
class WebSocketHub : public SessionHub {
public:
    const WebSocketOptions options;

    /// Calls the session's flush() at the end of the event loop's turn.
    virtual void flushLater(std::shared_ptr<WebSocketSession> session) = 0;
    /// The session's socket is closed. The hub forgets the session.
    virtual void finished(WebSocketSession& session) = 0;

protected:
    WebSocketHub(boost::asio::io_context& io, WebSocketOptions options, SessionHandler& handler,
                 Background background, Log& log)
        : SessionHub(io, handler, std::move(background), log, options.greetTime),
          options(options) {}
    ~WebSocketHub() = default;
};

}  // namespace usdlive::server
