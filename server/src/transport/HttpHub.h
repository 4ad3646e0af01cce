#pragma once

#include <boost/asio/io_context.hpp>

#include "usdlive/server/transport/HttpServer.h"

namespace usdlive::server {

class HttpConnection;

/// What connections know of the server they belong to. It abandons them when it goes; operations
/// that end after that do not call it any more.
class HttpHub {
public:
    boost::asio::io_context& io;
    const HttpServerOptions options;
    const HttpRouter router;
    Log& log;

    /// The connection has answered, failed, or become a session. The hub forgets it.
    virtual void finished(HttpConnection& connection) = 0;

protected:
    HttpHub(boost::asio::io_context& io, HttpServerOptions options, HttpRouter router, Log& log)
        : io(io), options(std::move(options)), router(std::move(router)), log(log) {}
    ~HttpHub() = default;
};

}  // namespace usdlive::server
