#pragma once

#include <memory>

#include "Hub.h"

namespace usdlive::server {

/// One request and its answer, then it closes; or the beginning of a session. Network thread.
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

[[nodiscard]] std::shared_ptr<HttpConnection> createHttpConnection(Hub& hub, Socket socket);

}  // namespace usdlive::server
