// A connection that HttpServer hands to the transport of its session.
#pragma once

#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <memory>
#include <optional>

#include "project/Subject.h"
#include "transport/Seats.h"
#include "transport/WebSocketTransport.h"
#include "usdlive/common/net/NetStream.h"

namespace usdlive::server {

/// The request for a WebSocket session, not answered yet.
struct Upgrade {
    boost::beast::http::request<boost::beast::http::empty_body> request;
    NetStream::Released connection;  ///< belongs to no io_context; is encrypted or not
    std::unique_ptr<Seat> seat;
    std::optional<SignedIn> user;  ///< nothing if the server does not ask users to sign in
    ShowsToken showsToken = {};    ///< set if the first message shows who it is (AC13)
};

}  // namespace usdlive::server
