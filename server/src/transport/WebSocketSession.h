// One client's session over a WebSocket.
#pragma once

#include <memory>
#include <string>

#include "transport/SessionCore.h"
#include "transport/Upgrade.h"
#include "transport/WebSocketHub.h"

namespace usdlive::server {

/// One client's session. Belongs to the thread of the hub's io_context.
class WebSocketSession : public SessionCore {
public:
    /// Answers the request and starts to read.
    virtual void start() = 0;
    virtual void setReading(bool reading) = 0;
    /// Returns the address of the client's end.
    [[nodiscard]] virtual const std::string& address() const = 0;

    /// Writes the queued frames. If a write is running, it continues with them.
    virtual void flush() = 0;
    /// Cuts the session off if it did not read or close in time.
    virtual void sweep(TimePoint now) = 0;
    /// Closes the socket and does not call the hub any more.
    virtual void abandon() = 0;

protected:
    using SessionCore::SessionCore;
};

/// The session takes the connection of `upgrade` to the hub's io_context.
[[nodiscard]] std::shared_ptr<WebSocketSession> createWebSocketSession(
    WebSocketHub& hub, SessionId id, std::unique_ptr<Upgrade> upgrade);

}  // namespace usdlive::server
