#pragma once

#include <memory>

#include "SessionCore.h"
#include "Upgrade.h"
#include "WebSocketHub.h"

namespace usdlive::server {

/// One client's session. Belongs to the thread of the hub's io_context.
class WebSocketSession : public SessionCore {
public:
    /// Answers the request and begins to read.
    virtual void start() = 0;
    virtual void setReading(bool reading) = 0;

    /// Writes what is queued, unless a write is on its way, which will go on with it.
    virtual void flush() = 0;
    /// Cuts it when it did not read or did not close in time.
    virtual void sweep(TimePoint now) = 0;
    /// Closes the socket, and the hub is not called any more.
    virtual void abandon() = 0;

protected:
    using SessionCore::SessionCore;
};

/// `socket` belongs to the hub's io_context.
[[nodiscard]] std::shared_ptr<WebSocketSession> createWebSocketSession(
    WebSocketHub& hub, SessionId id, Socket socket, std::unique_ptr<Upgrade> upgrade);

}  // namespace usdlive::server
