// Reads one HTTP request and answers it, or hands the connection over as a session.
#include "HttpConnection.h"

#include <array>
#include <boost/asio/post.hpp>
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
// The time limit for sending the answer and for the peer to close afterwards.
constexpr std::chrono::seconds kAnswerTime{5};

constexpr unsigned kBadRequest = 400, kForbidden = 403, kNotAllowed = 405, kUpgradeRequired = 426,
                   kHeadersTooLarge = 431, kInternal = 500, kUnavailable = 503;

using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

/// Returns the path without the query.
std::string_view pathOf(const Request& request) {
    const std::string_view target = view(request.target());
    return target.substr(0, target.find('?'));
}

class Connection final : public HttpConnection, public std::enable_shared_from_this<Connection> {
public:
    Connection(HttpHub& hub, Socket socket, std::shared_ptr<void> slot)
        : hub_(hub),
          socket_(std::move(socket)),
          slot_(std::move(slot)),
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
        if (now < deadline_) return;
        if (std::exchange(waits_, false))
            return answer({"text/plain", "the server is busy; try again\n", kUnavailable});
        cut();
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
            return answer({"text/plain", "headers too large\n", kHeadersTooLarge});
        if (error.category() == http::make_error_code(http::error::bad_method).category() &&
            error != http::error::end_of_stream && error != http::error::partial_message)
            return answer({"text/plain", "not HTTP: " + error.message() + "\n", kBadRequest});
        if (error) return finish();
        route(parser_.get());
    }

    void route(const Request& request) {
        const std::string_view path = pathOf(request);
        try {
            const HttpRoute route = hub_.router(path);
            if (const auto* refusal = std::get_if<HttpReply>(&route)) return answer(*refusal);
            if (request.method() != http::verb::get)
                return answer({"text/plain", "only GET\n", kNotAllowed});
            if (const auto* page = std::get_if<HttpPage>(&route)) return get(*page);
            session(request, *std::get<WebSocketTransport*>(route));
        } catch (const std::exception& fault) {
            hub_.log.write(LogLevel::Error, "http route failed",
                           {{"path", path}, {"error", fault.what()}});
            answer({"text/plain", "internal error of the server\n", kInternal});
        }
    }

    void get(const HttpPage& page) {
        waits_ = true;
        deadline_ = steady_clock::now() + hub_.options.answerTime;
        page([io = &hub_.io, weak = weak_from_this()](HttpReply reply) {
            asio::post(*io, [weak, reply = std::move(reply)]() mutable {
                const auto self = weak.lock();
                if (self && !self->done_ && std::exchange(self->waits_, false))
                    self->answer(std::move(reply));
            });
        });
    }

    void session(const Request& request, WebSocketTransport& transport) {
        // A client has to wait for the answer, so further bytes are not WebSocket.
        if (!beast::websocket::is_upgrade(request) || buffer_.size() != 0)
            return answer({"text/plain", "this is a WebSocket endpoint\n", kUpgradeRequired});
        if (!originAllowed(request)) {
            hub_.log.write(LogLevel::Warning, "origin refused",
                           {{"origin", view(request[http::field::origin])}});
            return answer({"text/plain",
                           "pages of this origin may not connect. Start the server with "
                           "--allow-origin to allow it\n",
                           kForbidden});
        }
        done_ = true;
        transport.take(std::make_unique<Upgrade>(
            Upgrade{parser_.release(), std::move(socket_), std::move(slot_)}));
        hub_.finished(*this);
    }

    bool originAllowed(const Request& request) const {
        const auto origin = request.find(http::field::origin);
        if (origin == request.end()) return true;
        for (const std::string& allowed : hub_.options.allowedOrigins)
            if (allowed == "*" || allowed == view(origin->value())) return true;
        return false;
    }

    void answer(HttpReply reply) {
        const auto status = http::status(reply.status);
        response_.result(status);
        response_.set(http::field::server, "usdlive");
        response_.set(http::field::content_type, reply.contentType);
        response_.set(http::field::cache_control, "no-store");
        if (status == http::status::method_not_allowed) response_.set(http::field::allow, "GET");
        if (status == http::status::upgrade_required) {
            response_.set(http::field::upgrade, "websocket");
            response_.set(http::field::connection, "upgrade, close");
        }
        response_.keep_alive(false);
        response_.body() = std::move(reply.body);
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

    // Reads the rest, because closing with unread bytes would reset the connection and could lose
    // the answer.
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

    HttpHub& hub_;
    Socket socket_;
    std::shared_ptr<void> slot_;
    beast::flat_buffer buffer_;
    http::request_parser<http::empty_body> parser_;
    Response response_;
    std::array<char, 512> scratch_;
    TimePoint deadline_;
    bool waits_ = false;  // for the page's answer
    bool done_ = false;
};

}  // namespace

std::shared_ptr<HttpConnection> createHttpConnection(HttpHub& hub, Socket socket,
                                                     std::shared_ptr<void> slot) {
    return std::make_shared<Connection>(hub, std::move(socket), std::move(slot));
}

}  // namespace usdlive::server
