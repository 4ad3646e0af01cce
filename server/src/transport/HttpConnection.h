#pragma once

#include <memory>

#include "HttpHub.h"
#include "Socket.h"

namespace usdlive::server {

/// Reads one request and answers it, or hands the connection over as a session. Belongs to the
/// thread of the hub's io_context.
class HttpConnection {
public:
    virtual ~HttpConnection() = default;
    virtual void start() = 0;
    /// Closes it when its time is over.
    virtual void sweep(TimePoint now) = 0;
    virtual void cut() = 0;
    /// The same, and the hub is not called any more.
    virtual void abandon() = 0;
};

/// `slot` is held as long as the connection is open, also as a session.
[[nodiscard]] std::shared_ptr<HttpConnection> createHttpConnection(HttpHub& hub, Socket socket,
                                                                   std::shared_ptr<void> slot);

}  // namespace usdlive::server
