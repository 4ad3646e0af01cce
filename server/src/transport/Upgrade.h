#pragma once

#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>

namespace usdlive::server {

/// The request that asks for a WebSocket session, not yet answered.
struct Upgrade {
    boost::beast::http::request<boost::beast::http::empty_body> request;
};

}  // namespace usdlive::server
