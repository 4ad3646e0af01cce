// A connection that HttpServer hands to the transport of its session.
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <memory>

#include "Socket.h"
#include "usdlive/server/transport/Seats.h"

namespace usdlive::server {

/// The request for a WebSocket session, not answered yet.
struct Upgrade {
    boost::beast::http::request<boost::beast::http::empty_body> request;
    Socket socket;  ///< still belongs to HttpServer's io_context
    std::unique_ptr<Seat> seat;
};

}  // namespace usdlive::server
