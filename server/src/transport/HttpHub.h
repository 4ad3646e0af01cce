// The part of the server that HTTP connections share.
#pragma once

#include <boost/asio/io_context.hpp>

#include "transport/HttpServer.h"

namespace usdlive::server {

class HttpConnection;

/// The part of the server that connections use. Its destructor abandons them; operations that end
/// later do not call it any more.
class HttpHub {
public:
    boost::asio::io_context& io;
    const HttpServerOptions options;
    const HttpRouter router;
    Log& log;

    /// Called when the connection has answered, failed, or become a session. The hub forgets it.
    virtual void finished(HttpConnection& connection) = 0;

protected:
    HttpHub(boost::asio::io_context& io, HttpServerOptions options, HttpRouter router, Log& log)
        : io(io), options(std::move(options)), router(std::move(router)), log(log) {}
    ~HttpHub() = default;
};

}  // namespace usdlive::server
