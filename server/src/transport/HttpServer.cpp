// Accepts connections, reads their requests, and hands sessions to the transports that serve them.
#include "transport/HttpServer.h"

#include <algorithm>
#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <unordered_map>
#include <utility>

#include "transport/HttpConnection.h"
#include "transport/WhileAlive.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using Executor = asio::io_context::executor_type;
using Acceptor = asio::basic_socket_acceptor<tcp, Executor>;

// Pause after a failed accept. Usually no file descriptors are left, and open connections continue.
constexpr milliseconds kAcceptPause{100};
// Pause while there is no seat for a waiting connection.
constexpr milliseconds kSeatPause{20};
constexpr milliseconds kLongestHeaderSweep{1'000};

class BeastHttpServer final : public HttpServer, public HttpHub {
public:
    BeastHttpServer(asio::io_context& io, HttpServerOptions options, HttpRouter router, Log& log,
                    Acceptor acceptor)
        : HttpHub(io, std::move(options), std::move(router), log),
          acceptor_(std::move(acceptor)),
          endpoint_(acceptor_.local_endpoint()),
          acceptTimer_(io),
          sweepTimer_(io),
          seats_(this->options.seats) {
        accept();
        sweepLater();
    }

    ~BeastHttpServer() override {
        for (const auto& [key, connection] : std::exchange(connections_, {})) connection->abandon();
    }

    std::uint16_t port() const override { return endpoint_.port(); }
    bool isLoopback() const override { return endpoint_.address().is_loopback(); }
    HttpCounters counters() const override {
        const Seats::Counts seats = seats_.counts();
        return {accepted_, seats.gaveWay, seats.guests + seats.members};
    }

    void stop() override {
        boost::system::error_code ignored;
        acceptor_.close(ignored);
        acceptTimer_.cancel();
        sweepTimer_.cancel();
        for (const auto& [key, connection] : std::exchange(connections_, {})) connection->abandon();
    }

    void finished(HttpConnection& connection) override { connections_.erase(&connection); }

private:
    /// Waits for the next connection. It stays in the system's queue until it has a seat.
    void accept() {
        acceptor_.async_wait(Acceptor::wait_read,
                             whileAlive(life_, [this](boost::system::error_code error) {
                                 if (!error) seat();
                             }));
    }

    void seat() {
        const TimePoint now = steady_clock::now();
        if (!seats_.makeRoom(now)) return acceptIn(kSeatPause);
        boost::system::error_code error;
        NetSocket socket(io);
        acceptor_.accept(socket, error);
        if (error == asio::error::would_block || error == asio::error::connection_aborted)
            return accept();  // the peer has left
        if (error) {
            log.write(LogLevel::Warning, "accept failed", {{"error", error.message()}});
            seats_.letOneGo(now);
            return acceptIn(kAcceptPause);
        }
        ++accepted_;
        boost::system::error_code ignored;
        const auto peer = socket.remote_endpoint(ignored);
        const auto connection = createHttpConnection(*this, NetStream(std::move(socket)),
                                                     seats_.take(peer.address().to_string(), now));
        connections_.emplace(connection.get(), connection);
        connection->start();
        accept();
    }

    void acceptIn(milliseconds pause) {
        acceptTimer_.expires_after(pause);
        acceptTimer_.async_wait(whileAlive(life_, [this](boost::system::error_code canceled) {
            if (!canceled) accept();
        }));
    }

    // One timer checks all connections.
    void sweepLater() {
        sweepTimer_.expires_after(std::min(kLongestHeaderSweep, options.headerTime / 4));
        sweepTimer_.async_wait(whileAlive(life_, [this](boost::system::error_code error) {
            if (error) return;
            // A copy, because connections are removed while they are visited.
            const auto connections = connections_;
            for (const auto& [key, connection] : connections)
                connection->sweep(steady_clock::now());
            sweepLater();
        }));
    }

    Acceptor acceptor_;
    const tcp::endpoint endpoint_;
    Timer acceptTimer_, sweepTimer_;
    Seats seats_;
    std::uint64_t accepted_ = 0;
    std::unordered_map<HttpConnection*, std::shared_ptr<HttpConnection>> connections_;
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

std::string addressText(const HttpServerOptions& options) {
    return options.host + ":" + std::to_string(options.port);
}

Result<Acceptor> listenAt(asio::io_context& io, const HttpServerOptions& options) {
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
    if (!error) acceptor.non_blocking(true, error);
    if (error) return failed(error);
    return acceptor;
}

}  // namespace

Result<std::unique_ptr<HttpServer>> createHttpServer(asio::io_context& io,
                                                     HttpServerOptions options, HttpRouter router,
                                                     Log& log) {
    auto acceptor = listenAt(io, options);
    if (!acceptor) return tl::unexpected(acceptor.error());
    return std::make_unique<BeastHttpServer>(io, std::move(options), std::move(router), log,
                                             std::move(*acceptor));
}

}  // namespace usdlive::server
