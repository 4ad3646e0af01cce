#include "HttpConnection.h"

#include <array>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <utility>

#include "Upgrade.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using std::chrono::steady_clock;

constexpr std::size_t kHeaderBytes = 8 * 1024;
constexpr std::string_view kSessionPath = "/live";
// For answers to leave and for the peer to close after them.
constexpr std::chrono::seconds kAnswerTime{5};

using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

/// The path without a query.
std::string_view pathOf(const Request& request) {
    const std::string_view target = view(request.target());
    return target.substr(0, target.find('?'));
}

class Connection final : public HttpConnection, public std::enable_shared_from_this<Connection> {
public:
    Connection(Hub& hub, Socket socket)
        : hub_(hub),
          socket_(std::move(socket)),
          buffer_(2 * kHeaderBytes),
          deadline_(steady_clock::now() + hub.options.headerTime) {
        parser_.header_limit(kHeaderBytes);
    }

    void start() override {
        http::async_read_header(socket_, buffer_, parser_,
                                [self = shared_from_this()](beast::error_code error, std::size_t) {
                                    self->onHeader(error);
                                });
    }

    void sweep(TimePoint now) override {
        if (now >= deadline_) cut();
    }

    void cut() override {
        beast::error_code ignored;
        socket_.close(ignored);
    }

    void abandon() override {
        done_ = true;
        cut();
    }

private:
    void onHeader(beast::error_code error) {
        if (done_) return;
        if (error == http::error::header_limit || error == http::error::buffer_overflow)
            return answer(http::status::request_header_fields_too_large, "headers too large\n");
        if (error.category() == http::make_error_code(http::error::bad_method).category() &&
            error != http::error::end_of_stream && error != http::error::partial_message)
            return answer(http::status::bad_request, "not HTTP: " + error.message() + "\n");
        if (error) return finish();
        route(parser_.get());
    }

    void route(const Request& request) {
        const std::string_view path = pathOf(request);
        const auto route = hub_.routes.find(path);
        if (path != kSessionPath && route == hub_.routes.end())
            return answer(http::status::not_found, "there is nothing here\n");
        if (request.method() != http::verb::get)
            return answer(http::status::method_not_allowed, "only GET\n");
        if (path == kSessionPath) return session(request);
        try {
            HttpReply reply = route->second();
            answer(http::status::ok, std::move(reply.body), reply.contentType);
        } catch (const std::exception& fault) {
            hub_.log.write(LogLevel::Error, "http route failed",
                           {{"path", path}, {"error", fault.what()}});
            answer(http::status::internal_server_error, "the server met a fault of its own\n");
        }
    }

    void session(const Request& request) {
        // A client waits for the answer before it goes on: more bytes are not WebSocket.
        if (!beast::websocket::is_upgrade(request) || buffer_.size() != 0)
            return answer(http::status::upgrade_required, "this is a WebSocket endpoint\n");
        if (!originAllowed(request)) {
            hub_.log.write(LogLevel::Warning, "origin refused",
                           {{"origin", view(request[http::field::origin])}});
            return answer(http::status::forbidden,
                          "pages of this origin may not connect; see --allow-origin\n");
        }
        done_ = true;
        hub_.upgrade(*this, std::move(socket_),
                     std::make_unique<Upgrade>(Upgrade{parser_.release()}));
    }

    bool originAllowed(const Request& request) const {
        const auto origin = request.find(http::field::origin);
        if (origin == request.end()) return true;
        for (const std::string& allowed : hub_.options.allowedOrigins)
            if (allowed == "*" || allowed == view(origin->value())) return true;
        return false;
    }

    void answer(http::status status, std::string body, const std::string& type = "text/plain") {
        response_.result(status);
        response_.set(http::field::content_type, type);
        response_.set(http::field::cache_control, "no-store");
        if (status == http::status::method_not_allowed) response_.set(http::field::allow, "GET");
        if (status == http::status::upgrade_required) {
            response_.set(http::field::upgrade, "websocket");
            response_.set(http::field::connection, "upgrade, close");
        }
        response_.keep_alive(false);
        response_.body() = std::move(body);
        response_.prepare_payload();
        deadline_ = steady_clock::now() + kAnswerTime;
        http::async_write(socket_, response_,
                          [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (error || self->done_) return self->finish();
                              beast::error_code ignored;
                              self->socket_.shutdown(Socket::shutdown_send, ignored);
                              self->drain();
                          });
    }

    // Closing with unread bytes would reset the connection and could take the answer along.
    void drain() {
        socket_.async_read_some(asio::buffer(scratch_),
                                [self = shared_from_this()](beast::error_code error, std::size_t) {
                                    if (error) return self->finish();
                                    self->drain();
                                });
    }

    void finish() {
        if (std::exchange(done_, true)) return;
        cut();
        hub_.finished(*this);
    }

    Hub& hub_;
    Socket socket_;
    beast::flat_buffer buffer_;
    http::request_parser<http::empty_body> parser_;
    Response response_;
    std::array<char, 512> scratch_;
    TimePoint deadline_;
    bool done_ = false;
};

}  // namespace

std::shared_ptr<HttpConnection> createHttpConnection(Hub& hub, Socket socket) {
    return std::make_shared<Connection>(hub, std::move(socket));
}

}  // namespace usdlive::server
