// Connects to a server over WebSocket.
#include <algorithm>
#include <atomic>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/connect.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <optional>
#include <thread>

#include "transport/MailboxConnection.h"
#include "transport/RetryDelay.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/fetch/IssuerSignIn.h"
#include "usdlive/common/net/ClientTls.h"
#include "usdlive/common/net/NetStream.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/transport/PeerLife.h"

namespace usdlive::client {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using boost::system::error_code;
using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

constexpr auto kConnectTimeout = seconds(10);
// A server that shows no life for this time is lost (SE7).
constexpr auto kPeerTime = seconds(10);
constexpr auto kPeerCheck = milliseconds(500);
// Messages are sent in fragments of this size, so that pings and pongs can pass between them. The
// system keeps about as many bytes that were not sent.
constexpr std::size_t kFragmentBytes = 64 * 1024;
constexpr std::size_t kLeastReadBytes = 64 * 1024, kMostReadBytes = 1024 * 1024;
// The time limit for sending the queue and the goodbye of a destroyed connection.
constexpr auto kGoodbye = milliseconds(500);

// A message of the server has one or more frames. The extra space is for those beside the largest.
constexpr std::size_t kMaxMessageBytes = kMaxFrameBytes + 8 * 1024 * 1024;

constexpr auto kTuple = asio::as_tuple(asio::use_awaitable);

using Stream = websocket::stream<NetStream, false>;

// One connection from its handshake to its end. Belongs to the network thread; each coroutine that
// uses it keeps it alive.
struct Line {
    explicit Line(asio::io_context& context) : stream(NetStream(context)), work(context) {
        work.expires_at(steady_clock::time_point::max());
    }
    // Ends the connection. Only the first reason is kept.
    void end(Error why) {
        if (!reason) reason = std::move(why);
        wake();
        net().close();
    }
    void wake() { work.cancel(); }
    NetStream& net() { return stream.next_layer(); }

    Stream stream;
    asio::steady_timer
        work;  // never expires; cancelled when there is something to write or room for reading
    PeerLife life{kPeerTime, steady_clock::now()};
    bool isPinging = false, pingsAgain = false;
    bool isConnecting = true, hasTimedOut = false;
    std::uint64_t generation = 0;
    std::optional<Error> reason;
};

class WebSocketConnection final : public MailboxConnection {
public:
    WebSocketConnection(const ServerAddress& address, Brings brings)
        : MailboxConnection(address, brings), pause_(context_) {
        asio::co_spawn(context_, run(), asio::detached);
        thread_ = startThread("usdlive network", [this] { context_.run(); });
    }

    ~WebSocketConnection() override {
        isDestroyed_ = true;
        asio::post(context_, [this] { sayGoodbye(); });
        thread_.join();
    }

private:
    void queued() override {
        asio::post(context_, [this] {
            if (line_) line_->wake();
        });
    }

    void madeRoom() override {
        asio::post(context_, [this] { pause_.cancel(); });
    }

    void drop(std::uint64_t generation, std::string why) override {
        asio::post(context_, [this, generation, why = std::move(why)] {
            if (!line_ || line_->generation != generation) return;
            line_->end(lost(why));
            pause_.cancel();
        });
    }

    [[nodiscard]] Error describe(const std::string& what, const error_code& error) const {
        const bool refused = error == asio::error::connection_refused;
        return {ErrorCode::NotConnected,
                what + " " + where() + ": " + error.message() +
                    (refused ? ". Is `usdlive serve` running there?" : "")};
    }

    asio::awaitable<void> run() {
        RetryDelay delay;
        while (!leaving_) {
            const auto start = steady_clock::now();
            Error reason = co_await attempt();
            if (leaving_) break;
            mailbox_.lost(std::move(reason));
            co_await rest(delay.next(steady_clock::now() - start));
            while (!leaving_ && !mailbox_.hasRoom()) co_await rest(RetryDelay::kLongest);
        }
        context_.stop();
    }

    asio::awaitable<void> rest(milliseconds time) {
        pause_.expires_after(time);
        co_await pause_.async_wait(kTuple);
    }

    // Connects and reads until the connection is lost. Returns the reason.
    asio::awaitable<Error> attempt() {
        asio::ip::tcp::resolver resolver(context_);
        // Waits here, because async_resolve() would start a thread, which may be refused.
        error_code resolveError;
        const auto endpoints =
            resolver.resolve(address_.host, std::to_string(address_.port), resolveError);
        if (resolveError) co_return describe("no address found for", resolveError);
        // Waits here, too, if the token has to be renewed, which the server would not.
        const auto authorization =
            address_.token.empty()
                ? fetch::authorizationFor(address_.host, address_.port, address_.isSecure,
                                          [this] { return isDestroyed_.load(); })
                : Result<std::optional<std::string>>("Bearer " + address_.token);
        if (!authorization) co_return authorization.error();

        auto line = line_ = std::make_shared<Line>(context_);
        if (auto error = co_await connect(line, endpoints))
            co_return finish(*line, std::move(*error));
        if (auto error = co_await handshake(*line, *authorization))
            co_return finish(*line, std::move(*error));
        line->generation = mailbox_.opened();
        takeControlFrames(*line);
        ping(line);  // measures the empty line
        asio::co_spawn(context_, write(line), asio::detached);
        asio::co_spawn(context_, watch(line), asio::detached);
        co_return finish(*line, co_await read(*line));
    }

    /// Connects, and encrypts the connection if the address demands it.
    asio::awaitable<std::optional<Error>> connect(std::shared_ptr<Line> line,
                                                  asio::ip::tcp::resolver::results_type endpoints) {
        asio::steady_timer limit(context_, kConnectTimeout);
        limit.async_wait([line](error_code error) {
            if (error || !line->isConnecting) return;
            line->hasTimedOut = true;
            line->net().close();
        });
        auto& socket = line->net().socket();
        auto [error, endpoint] = co_await asio::async_connect(socket, endpoints, kTuple);
        // Without this, Nagle's algorithm and delayed acknowledgements delay small messages by 40
        // ms.
        if (!error) socket.set_option(asio::ip::tcp::no_delay(true), error);
        if (error) co_return describe("cannot reach", timeoutOr(*line, error));
        limitUnsent(socket.native_handle(), kFragmentBytes);
        if (address_.isSecure)
            if (const auto encrypted = co_await encrypt(*line); !encrypted)
                co_return encrypted.error();
        line->isConnecting = false;
        co_return std::nullopt;
    }

    asio::awaitable<Result<void>> encrypt(Line& line) {
        ClientTls tls(KnownServers(), address_.host, address_.port, ClientTls::Trust::FirstUse);
        if (auto begun = tls.encrypt(line.net()); !begun) co_return begun;
        const auto [error] = co_await line.net().async_handshake(kTuple);
        co_return tls.check(timeoutOr(line, error));
    }

    /// A connection that took too long was closed, which ends the operation with another error.
    static error_code timeoutOr(const Line& line, const error_code& error) {
        return line.hasTimedOut ? error_code(asio::error::timed_out) : error;
    }

    [[nodiscard]] Error finish(Line& line, Error reason) {
        line.end(std::move(reason));
        line_.reset();
        return *line.reason;
    }

    asio::awaitable<std::optional<Error>> handshake(Line& line,
                                                    std::optional<std::string> authorization) {
        auto& stream = line.stream;
        stream.set_option(websocket::stream_base::timeout{kConnectTimeout,
                                                          websocket::stream_base::none(), false});
        stream.set_option(websocket::stream_base::decorator(
            [authorization = std::move(authorization)](websocket::request_type& request) {
                request.set(http::field::user_agent, "usdlive");
                if (authorization) request.set(http::field::authorization, *authorization);
            }));
        stream.read_message_max(kMaxMessageBytes);
        stream.write_buffer_bytes(kFragmentBytes);
        stream.auto_fragment(true);
        stream.binary(true);

        websocket::response_type response;
        const std::string target =
            (address_.project.empty() ? "" : "/" + percentEncoded(address_.project)) + "/live";
        const auto [error] =
            co_await stream.async_handshake(response, address_.hostAndPort(), target, kTuple);
        if (error == websocket::error::upgrade_declined)
            co_return Error{ErrorCode::NotConnected, declined(response)};
        if (error) co_return describe("no usdlive server at", error);
        co_return std::nullopt;
    }

    [[nodiscard]] std::string declined(const websocket::response_type& response) const {
        if (response[http::field::server] == "usdlive" && !response.body().empty())
            return "cannot connect to " + where() + ": " +
                   response.body().substr(0, response.body().find('\n'));
        return "no usdlive server at " + where() + ": HTTP " +
               std::to_string(response.result_int());
    }

    asio::awaitable<Error> read(Line& line) {
        beast::flat_buffer buffer;
        for (;;) {
            const auto [error, size] = co_await line.stream.async_read_some(
                buffer, std::clamp(buffer.size(), kLeastReadBytes, kMostReadBytes), kTuple);
            if (error) co_return lost(error.message());
            line.life.received(steady_clock::now());
            if (line.stream.got_text())
                co_return Error{ErrorCode::TextFrame, where() + " sent a text message"};
            if (!line.stream.is_message_done()) continue;
            const auto* begin = static_cast<const std::uint8_t*>(buffer.data().data());
            const bool room =
                mailbox_.message(std::make_shared<const Bytes>(begin, begin + buffer.size()));
            buffer.clear();
            if (buffer.capacity() > kMostReadBytes) buffer.shrink_to_fit();
            while (!leaving_ && !line.reason && !room && !mailbox_.hasRoom())
                co_await rest(RetryDelay::kLongest);
        }
    }

    asio::awaitable<void> write(std::shared_ptr<Line> line) {
        std::vector<asio::const_buffer> buffers;
        while (!line->reason) {
            const auto batch = mailbox_.takeBatch();
            if (batch.empty()) {
                if (leaving_) break;
                co_await line->work.async_wait(kTuple);
                continue;
            }
            buffers.clear();
            for (const auto& bytes : batch) buffers.push_back(asio::buffer(*bytes));
            const auto [error, size] = co_await line->stream.async_write(buffers, kTuple);
            if (error) {
                line->end(lost(error.message()));
                co_return;
            }
            // After the end of this connection the mailbox has dropped everything.
            if (line->reason) continue;
            mailbox_.written(asio::buffer_size(buffers));
            if (mailbox_.wantsMark()) ping(line);
        }
        if (leaving_ && !line->reason)
            co_await line->stream.async_close(websocket::close_code::normal, kTuple);
    }

    /// The pong to a ping says that the server has received everything that was sent before the
    /// ping (TL1).
    void ping(const std::shared_ptr<Line>& line) {
        line->pingsAgain = line->isPinging;
        if (std::exchange(line->isPinging, true)) return;
        const std::string payload = pingPayload(mailbox_.mark());
        line->stream.async_ping({payload.data(), payload.size()}, [this, line](error_code error) {
            line->isPinging = false;
            if (error || line->reason) return;
            line->life.pingWritten(progressOf(*line));
            if (line->pingsAgain) ping(line);
        });
    }

    void takeControlFrames(Line& line) {
        line.stream.control_callback(
            [this, &line](websocket::frame_type type, beast::string_view payload) {
                line.life.received(steady_clock::now());
                if (type != websocket::frame_type::pong || line.reason) return;
                if (const auto mark = markOf({payload.data(), payload.size()}))
                    mailbox_.acknowledged(*mark);
            });
    }

    [[nodiscard]] static std::optional<SendProgress> progressOf(Line& line) {
        return sendProgress(line.net().socket().native_handle());
    }

    asio::awaitable<void> watch(std::shared_ptr<Line> line) {
        asio::steady_timer pause(context_);
        while (!line->reason) {
            pause.expires_after(kPeerCheck);
            co_await pause.async_wait(kTuple);
            if (line->reason) co_return;
            switch (line->life.check(progressOf(*line), steady_clock::now())) {
                case PeerLife::Verdict::Alive:
                    break;
                case PeerLife::Verdict::SendPing:
                    ping(line);
                    break;
                case PeerLife::Verdict::Lost:
                    line->end(lost("the server does not answer"));
            }
        }
    }

    // The connection has no owner any more: sends the queue and the goodbye, then ends the thread.
    void sayGoodbye() {
        leaving_ = true;
        pause_.cancel();
        if (!line_ || line_->generation == 0) {
            context_.stop();
            return;
        }
        line_->wake();
        asio::co_spawn(context_, stopLater(line_), asio::detached);
    }

    asio::awaitable<void> stopLater(std::shared_ptr<Line> line) {
        asio::steady_timer timer(context_, kGoodbye);
        co_await timer.async_wait(kTuple);
        line->end({ErrorCode::NotConnected, "left"});
        context_.stop();
    }

    // Used by the network thread only.
    asio::io_context context_{1};
    asio::steady_timer pause_;
    std::shared_ptr<Line> line_;  // the current connection, also while it is being opened
    bool leaving_ = false;

    std::atomic<bool> isDestroyed_ = false;  // any thread
    std::thread thread_;
};

}  // namespace

std::unique_ptr<Connection> createWebSocketConnection(const ServerAddress& address,
                                                      Connection::Brings brings) {
    return std::make_unique<WebSocketConnection>(address, brings);
}

}  // namespace usdlive::client
