// One HTTP connection.
#pragma once

#include <memory>

#include "transport/HttpHub.h"
#include "transport/Seats.h"
#include "transport/Timer.h"
#include "usdlive/common/net/NetStream.h"

namespace usdlive::server {

/// Reads one request and answers it, or hands the connection over as a session. Belongs to the
/// thread of the hub's io_context.
class HttpConnection {
public:
    virtual ~HttpConnection() = default;
    virtual void start() = 0;
    /// Closes the connection if its time is over.
    virtual void sweep(TimePoint now) = 0;
    virtual void cut() = 0;
    /// Cuts the connection and does not call the hub any more.
    virtual void abandon() = 0;
};

/// Holds `seat` while the connection is open, also as a session.
[[nodiscard]] std::shared_ptr<HttpConnection> createHttpConnection(HttpHub& hub, NetStream stream,
                                                                   std::unique_ptr<Seat> seat);

}  // namespace usdlive::server
