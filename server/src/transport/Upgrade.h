// A connection that HttpServer hands to the transport of its session.
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <memory>

#include "Socket.h"

namespace usdlive::server {

/// The request for a WebSocket session, not answered yet.
struct Upgrade {
    boost::beast::http::request<boost::beast::http::empty_body> request;
    Socket socket;               ///< still belongs to HttpServer's io_context
    std::shared_ptr<void> slot;  ///< counts as a connection while it is held
};

}  // namespace usdlive::server
