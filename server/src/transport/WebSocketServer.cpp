#include "usdlive/server/transport/WebSocketServer.h"

#include <algorithm>
#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <unordered_map>
#include <utility>

#include "HttpConnection.h"
#include "Hub.h"
#include "Upgrade.h"
#include "WebSocketSession.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using Executor = asio::io_context::executor_type;
using Acceptor = asio::basic_socket_acceptor<tcp, Executor>;
using Timer = asio::basic_waitable_timer<steady_clock, asio::wait_traits<steady_clock>, Executor>;

// No file descriptors left, most likely: those that are open go on being served.
constexpr milliseconds kAcceptPause{100};
constexpr milliseconds kLongestSweep{1'000};

/// A handler that does nothing once the server, whose `life` it is, has gone.
template <class Function>
auto whileAlive(const std::shared_ptr<int>& life, Function function) {
    return [alive = std::weak_ptr(life), function = std::move(function)](auto... arguments) {
        if (!alive.expired()) function(arguments...);
    };
}

class Server final : public WebSocketServer, public Hub {
public:
    Server(asio::io_context& io, WebSocketServerOptions options, SessionHandler& handler,
           HttpRoutes routes, Background background, Log& log, Acceptor acceptor)
        : Hub(io, std::move(options), handler, std::move(routes), std::move(background), log),
          acceptor_(std::move(acceptor)),
          endpoint_(acceptor_.local_endpoint()),
          acceptTimer_(io),
          sweepTimer_(io) {
        accept();
        sweepLater();
    }

    ~Server() override {
        for (const auto& [id, session] : std::exchange(sessions_, {})) session->abandon();
        for (const auto& [key, connection] : std::exchange(connections_, {})) connection->abandon();
    }

    std::uint16_t port() const override { return endpoint_.port(); }
    bool isLoopback() const override { return endpoint_.address().is_loopback(); }
    std::string_view name() const override { return "websocket"; }
    const TransportCounters& counters() const override { return Hub::counters; }

    void send(SessionId session, SharedBytes frames) override {
        if (const auto* found = find(session)) found->get()->send(std::move(frames));
    }
    bool congested(SessionId session) override {
        const auto* found = find(session);
        return found && found->get()->congested();
    }
    void sendBeside(SessionId session, FrameSource source) override {
        if (const auto* found = find(session)) found->get()->sendBeside(std::move(source));
    }
    void close(SessionId session) override { closeFor(session, std::nullopt); }
    void close(SessionId session, const Error& why) override { closeFor(session, why); }
    void closeAll(const Error& why) override {
        for (const auto& [id, session] : copy(sessions_)) session->close(why);
    }
    void setReading(SessionId session, bool reading) override {
        if (const auto* found = find(session)) found->get()->setReading(reading);
    }

    void stop(const Error& why, milliseconds time, std::function<void()> done) override {
        stopped_ = std::move(done);
        stopDeadline_ = steady_clock::now() + time;
        boost::system::error_code ignored;
        acceptor_.close(ignored);
        acceptTimer_.cancel();
        for (const auto& [key, connection] : copy(connections_)) connection->cut();
        closeAll(why);
        sweepLater();
        tellStopped();
    }

    // What connections ask for (Hub).
    void finished(HttpConnection& connection) override {
        connections_.erase(&connection);
        countConnections();
    }

    void upgrade(HttpConnection& connection, Socket socket,
                 std::unique_ptr<Upgrade> upgrade) override {
        const SessionId id = ++lastSession_;
        const auto session = createWebSocketSession(*this, id, std::move(socket));
        sessions_.emplace(id, session);
        connections_.erase(&connection);
        session->start(std::move(upgrade));
    }

    void flushLater(std::shared_ptr<WebSocketSession> session) override {
        toFlush_.push_back(std::move(session));
        if (toFlush_.size() > 1) return;
        asio::post(io, whileAlive(life_, [this] { flush(); }));
    }

    void tellClosed(SessionId session) override {
        asio::post(io, whileAlive(life_, [this, session] { handler.closed(session); }));
    }

    void finished(WebSocketSession& session) override {
        sessions_.erase(session.id());
        countConnections();
        tellStopped();
    }

private:
    template <class Map>
    static Map copy(const Map& map) {
        return map;  // to walk while its members go
    }

    const std::shared_ptr<WebSocketSession>* find(SessionId id) const {
        const auto entry = sessions_.find(id);
        return entry == sessions_.end() ? nullptr : &entry->second;
    }

    void closeFor(SessionId id, const std::optional<Error>& why) {
        if (const auto* found = find(id)) {
            const auto session = *found;  // it may take itself out of sessions_
            session->close(why);
        }
    }

    void countConnections() { Hub::counters.connections = sessions_.size() + connections_.size(); }

    void accept() {
        acceptor_.async_accept(
            whileAlive(life_, [this](boost::system::error_code error, Socket& socket) {
                onAccepted(error, socket);
            }));
    }

    void onAccepted(boost::system::error_code error, Socket& socket) {
        if (!acceptor_.is_open()) return;
        if (error) {
            log.write(LogLevel::Warning, "accept failed", {{"error", error.message()}});
            acceptTimer_.expires_after(kAcceptPause);
            acceptTimer_.async_wait(whileAlive(life_, [this](boost::system::error_code canceled) {
                if (!canceled) accept();
            }));
            return;
        }
        if (sessions_.size() + connections_.size() >= options.maxConnections) {
            ++Hub::counters.turnedAway;
        } else {
            ++Hub::counters.accepted;
            const auto connection = createHttpConnection(*this, std::move(socket));
            connections_.emplace(connection.get(), connection);
            countConnections();
            connection->start();
        }
        accept();
    }

    void flush() {
        // A flush can ask for another one, which is then of the next turn.
        flushing_.swap(toFlush_);
        for (const auto& session : flushing_) session->flush();
        flushing_.clear();
    }

    // One timer for all that waits for a peer: a timer for each write would cost more than the
    // write.
    void sweepLater() {
        milliseconds pause =
            std::min({kLongestSweep, options.headerTime / 4, options.slowReaderTime / 4});
        if (stopDeadline_) pause = milliseconds(50);
        sweepTimer_.expires_after(pause);
        sweepTimer_.async_wait(whileAlive(life_, [this](boost::system::error_code error) {
            if (!error) sweep();
        }));
    }

    void sweep() {
        const TimePoint now = steady_clock::now();
        for (const auto& [key, connection] : copy(connections_)) connection->sweep(now);
        for (const auto& [id, session] : copy(sessions_)) session->sweep(now);
        if (stopDeadline_ && now >= *stopDeadline_)
            for (const auto& [id, session] : copy(sessions_)) session->cut();
        sweepLater();
    }

    void tellStopped() {
        if (stopped_ && sessions_.empty()) asio::post(io, std::exchange(stopped_, nullptr));
    }

    Acceptor acceptor_;
    const tcp::endpoint endpoint_;
    Timer acceptTimer_, sweepTimer_;
    SessionId lastSession_ = 0;
    std::unordered_map<SessionId, std::shared_ptr<WebSocketSession>> sessions_;
    std::unordered_map<HttpConnection*, std::shared_ptr<HttpConnection>> connections_;
    std::vector<std::shared_ptr<WebSocketSession>> toFlush_, flushing_;
    std::optional<TimePoint> stopDeadline_;
    std::function<void()> stopped_;
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

std::string addressText(const WebSocketServerOptions& options) {
    return options.host + ":" + std::to_string(options.port);
}

Result<Acceptor> listenAt(asio::io_context& io, const WebSocketServerOptions& options) {
    const auto failed = [&](const boost::system::error_code& error) {
        return fail(ErrorCode::InvalidConfiguration,
                    "cannot listen at " + addressText(options) + ": " + error.message());
    };
    boost::system::error_code error;
    const auto found = tcp::resolver(io).resolve(options.host, std::to_string(options.port),
                                                 tcp::resolver::passive, error);
    if (error) return failed(error);
    const tcp::endpoint endpoint = found.begin()->endpoint();
    Acceptor acceptor(io);
    acceptor.open(endpoint.protocol(), error);
    if (!error) acceptor.set_option(Acceptor::reuse_address(true), error);
    if (!error) acceptor.bind(endpoint, error);
    if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
    if (error) return failed(error);
    return acceptor;
}

}  // namespace

Result<std::unique_ptr<WebSocketServer>> createWebSocketServer(asio::io_context& io,
                                                               WebSocketServerOptions options,
                                                               SessionHandler& handler,
                                                               HttpRoutes routes,
                                                               Background background, Log& log) {
    auto acceptor = listenAt(io, options);
    if (!acceptor) return tl::unexpected(acceptor.error());
    return std::make_unique<Server>(io, std::move(options), handler, std::move(routes),
                                    std::move(background), log, std::move(*acceptor));
}

}  // namespace usdlive::server
