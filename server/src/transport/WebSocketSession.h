#pragma once

#include <memory>
#include <optional>

#include "Upgrade.h"
#include "WebSocketHub.h"

namespace usdlive::server {

/// One client's session. Belongs to the thread of the hub's io_context.
class WebSocketSession {
public:
    virtual ~WebSocketSession() = default;
    [[nodiscard]] virtual SessionId id() const = 0;

    /// Answers the request and begins to read.
    virtual void start() = 0;
    virtual void send(SharedBytes frames) = 0;
    [[nodiscard]] virtual bool congested() = 0;
    virtual void sendBeside(FrameSource source) = 0;
    virtual void close(const std::optional<Error>& why) = 0;
    virtual void setReading(bool reading) = 0;

    /// Writes what is queued, unless a write is on its way, which will go on with it.
    virtual void flush() = 0;
    /// Cuts it when it did not read or did not close in time.
    virtual void sweep(TimePoint now) = 0;
    virtual void cut() = 0;
    /// Closes the socket, and the hub is not called any more.
    virtual void abandon() = 0;
};

/// `socket` belongs to the hub's io_context.
[[nodiscard]] std::shared_ptr<WebSocketSession> createWebSocketSession(
    WebSocketHub& hub, SessionId id, Socket socket, std::unique_ptr<Upgrade> upgrade);

}  // namespace usdlive::server
