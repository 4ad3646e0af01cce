// Accepts connections, reads their requests, and hands sessions to the transports that serve them.
#include "usdlive/server/transport/HttpServer.h"

#include <algorithm>
#include <atomic>
#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <unordered_map>
#include <utility>

#include "HttpConnection.h"
#include "WhileAlive.h"

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
constexpr milliseconds kLongestHeaderSweep{1'000};

class BeastHttpServer final : public HttpServer, public HttpHub {
public:
    BeastHttpServer(asio::io_context& io, HttpServerOptions options, HttpRouter router, Log& log,
                    Acceptor acceptor)
        : HttpHub(io, std::move(options), std::move(router), log),
          acceptor_(std::move(acceptor)),
          endpoint_(acceptor_.local_endpoint()),
          acceptTimer_(io),
          sweepTimer_(io) {
        accept();
        sweepLater();
    }

    ~BeastHttpServer() override {
        for (const auto& [key, connection] : std::exchange(connections_, {})) connection->abandon();
    }

    std::uint16_t port() const override { return endpoint_.port(); }
    bool isLoopback() const override { return endpoint_.address().is_loopback(); }
    HttpCounters counters() const override {
        HttpCounters counters = counters_;
        counters.connections = *open_;
        return counters;
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
    void accept() {
        acceptor_.async_accept(
            whileAlive(life_, [this](boost::system::error_code error, Socket socket) {
                onAccepted(error, std::move(socket));
            }));
    }

    void onAccepted(boost::system::error_code error, Socket socket) {
        if (!acceptor_.is_open()) return;
        if (error) {
            log.write(LogLevel::Warning, "accept failed", {{"error", error.message()}});
            acceptTimer_.expires_after(kAcceptPause);
            acceptTimer_.async_wait(whileAlive(life_, [this](boost::system::error_code canceled) {
                if (!canceled) accept();
            }));
            return;
        }
        if (*open_ >= options.maxConnections) {
            ++counters_.turnedAway;
        } else {
            ++counters_.accepted;
            const auto connection = createHttpConnection(*this, std::move(socket), slot());
            connections_.emplace(connection.get(), connection);
            connection->start();
        }
        accept();
    }

    /// Counts a connection until the last copy is destroyed, on any thread.
    std::shared_ptr<void> slot() {
        ++*open_;
        return {nullptr, [open = open_](void*) { --*open; }};
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
    HttpCounters counters_;
    const std::shared_ptr<std::atomic<std::size_t>> open_ =
        std::make_shared<std::atomic<std::size_t>>(0);
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
