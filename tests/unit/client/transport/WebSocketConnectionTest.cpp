// Tests a client's WebSocket connection against a small server.
#include <gtest/gtest.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <future>
#include <thread>

#include "transport/Connection.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/Snapshot.h"

using namespace usdlive;
using namespace std::chrono_literals;
using client::Connection;
namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using Socket = websocket::stream<asio::ip::tcp::socket>;

namespace {

SharedBytes bytesOf(std::string_view text) {
    const auto view = asBytes(text);
    return std::make_shared<const Bytes>(view.begin(), view.end());
}

// A server that runs on the test's thread and does only what the test requests.
class SmallServer {
public:
    explicit SmallServer(std::uint16_t port = 0)
        : acceptor_(context_, {asio::ip::address_v4::loopback(), port}) {}

    std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
    client::ServerAddress address() const { return {"127.0.0.1", port(), "shot.usda"}; }

    asio::ip::tcp::socket acceptTcp() {
        asio::ip::tcp::socket socket(context_);
        acceptor_.accept(socket);
        return socket;
    }
    Socket accept() {
        Socket socket(acceptTcp());
        boost::beast::flat_buffer buffer;
        boost::beast::http::read(socket.next_layer(), buffer, request_);
        socket.read_message_max(0);
        socket.accept(request_);
        socket.binary(true);
        return socket;
    }
    const auto& request() const { return request_; }

private:
    asio::io_context context_;
    asio::ip::tcp::acceptor acceptor_;
    boost::beast::http::request<boost::beast::http::string_body> request_;
};

std::string read(Socket& socket) {
    boost::beast::flat_buffer buffer;
    socket.read(buffer);
    return {static_cast<const char*>(buffer.data().data()), buffer.size()};
}

std::string codeOfRead(Socket& socket) {
    boost::beast::flat_buffer buffer;
    boost::system::error_code error;
    socket.read(buffer, error);
    return error.message();
}

// A long time, which only a failure needs: a sanitizer on a busy machine takes 10 s for the largest
// messages.
std::optional<Connection::Happening> next(Connection& connection) {
    if (!connection.wait(60s)) return std::nullopt;
    auto happenings = connection.poll(1);
    if (happenings.empty()) return std::nullopt;
    return std::move(happenings.front());
}

template <class T>
testing::AssertionResult isNext(Connection& connection) {
    const auto happening = next(connection);
    if (!happening) return testing::AssertionFailure() << "nothing happened";
    if (std::holds_alternative<T>(*happening)) return testing::AssertionSuccess();
    if (const auto* lost = std::get_if<Connection::Lost>(&*happening))
        return testing::AssertionFailure() << "lost: " << lost->reason.message;
    return testing::AssertionFailure() << "happening number " << happening->index();
}

std::string nextMessage(Connection& connection) {
    const auto happening = next(connection);
    if (!happening) return "(nothing)";
    const auto* message = std::get_if<Connection::Message>(&*happening);
    return message ? std::string(asText(*std::get<SharedBytes>(message->content))) : "(no message)";
}

}  // namespace

TEST(WebSocketConnection, SpeaksBinaryAtLive) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    EXPECT_EQ(server.request().target(), "/live");
    EXPECT_EQ(server.request()["Host"], "127.0.0.1:" + std::to_string(server.port()));
    EXPECT_EQ(server.request().count("Sec-WebSocket-Extensions"), 0u);

    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    connection->send(bytesOf("hello"));
    EXPECT_EQ(read(socket), "hello");
    EXPECT_TRUE(socket.got_binary());
    socket.write(asio::buffer(std::string("welcome")));
    socket.write(asio::buffer(std::string("more")));
    EXPECT_EQ(nextMessage(*connection), "welcome");
    EXPECT_EQ(nextMessage(*connection), "more");
}

// Works like an editor: a reader for each connection decodes what arrives.
TEST(WebSocketConnection, DeliversFrames) {
    LayerDoc doc;
    ASSERT_TRUE(doc.apply("/A", CreateSpec{SpecKind::Prim}));
    ASSERT_TRUE(doc.apply("/A", SetField{"comment", {}, stringValue(std::string(200'000, 'c'))}));
    std::vector<SnapshotFrame> chunks;
    SnapshotEncoder encoder(doc, 1);
    while (auto chunk = encoder.next()) chunks.push_back(std::move(*chunk));
    ASSERT_GE(chunks.size(), 2u);

    SmallServer server;
    const auto connection =
        client::createWebSocketConnection(server.address(), Connection::Brings::Frames);
    const auto received = [&]() -> Result<client::Received> {
        const auto happening = next(*connection);
        const auto* message = happening ? std::get_if<Connection::Message>(&*happening) : nullptr;
        const auto* content =
            message ? std::get_if<client::ReceivedMessage>(&message->content) : nullptr;
        if (!content || content->frames.size() != 1)
            return fail(ErrorCode::Internal, "not a message of one frame");
        return content->frames[0];
    };
    {
        auto socket = server.accept();
        ASSERT_TRUE(isNext<Connection::Opened>(*connection));
        socket.write(asio::buffer(encodeFrame(chunks[0])));
        const auto first = received();
        ASSERT_TRUE(first) << first.error().message;
        EXPECT_FALSE(std::get<client::ReceivedSnapshot>(*first).whole);
    }
    ASSERT_TRUE(isNext<Connection::Lost>(*connection));
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    for (const SnapshotFrame& chunk : chunks) {
        socket.write(asio::buffer(encodeFrame(chunk)));
        const auto part = received();
        ASSERT_TRUE(part) << part.error().message;
        const auto& snapshot = std::get<client::ReceivedSnapshot>(*part);
        ASSERT_EQ(snapshot.whole.has_value(), chunk.last);
        if (chunk.last) {
            EXPECT_EQ(snapshot.whole->dump(), doc.dump());
        }
    }
    socket.write(asio::buffer(std::string("nonsense")));
    const auto nonsense = received();
    ASSERT_FALSE(nonsense);
    EXPECT_NE(nonsense.error().code, ErrorCode::Internal);
}

TEST(WebSocketConnection, QueuedMessagesAreSentInOrder) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));

    std::string all;
    for (int i = 0; i < 2000; ++i) {
        const std::string part = std::to_string(i) + std::string(std::size_t(i % 3000), '.') + "\n";
        connection->send(bytesOf(part));
        all += part;
    }
    std::string got;
    int messages = 0;
    for (; got.size() < all.size(); ++messages) got += read(socket);
    EXPECT_EQ(got, all);
    EXPECT_LT(messages, 1000);
    for (int i = 0; i < 500 && connection->queuedBytes() != 0; ++i)
        std::this_thread::sleep_for(10ms);
    EXPECT_EQ(connection->queuedBytes(), 0u);
}

TEST(WebSocketConnection, TakesTheLargestFrameAndASmallOneBesideIt) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    const std::string large(kMaxFrameBytes + 4 + 1000, 'x');
    std::thread writer([&] { socket.write(asio::buffer(large)); });
    ASSERT_TRUE(connection->wait(20s));
    EXPECT_TRUE(nextMessage(*connection) == large);
    writer.join();
}

TEST(WebSocketConnection, LeavesAServerThatSendsTooMuch) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    std::thread writer([&] {
        boost::system::error_code ignored;
        socket.write(asio::buffer(std::string(2 * kMaxFrameBytes, 'x')), ignored);
    });
    EXPECT_TRUE(isNext<Connection::Lost>(*connection));
    writer.join();
}

TEST(WebSocketConnection, LeavesAServerThatSendsText) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    socket.text(true);
    socket.write(asio::buffer(std::string("{}")));
    const auto happening = next(*connection);
    ASSERT_TRUE(happening && std::holds_alternative<Connection::Lost>(*happening));
    EXPECT_EQ(std::get<Connection::Lost>(*happening).reason.code, ErrorCode::TextFrame);
}

TEST(WebSocketConnection, ReconnectsAfterALoss) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    for (int i = 0; i < 3; ++i) {
        auto socket = server.accept();
        ASSERT_TRUE(isNext<Connection::Opened>(*connection));
        connection->send(bytesOf("hello " + std::to_string(i)));
        EXPECT_EQ(read(socket), "hello " + std::to_string(i));
        socket.next_layer().close();
        ASSERT_TRUE(isNext<Connection::Lost>(*connection));
    }
}

TEST(WebSocketConnection, SendsNothingOfAnEarlierConnectionToALaterOne) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    {
        auto socket = server.accept();
        ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    }
    // The second connection is open while its owner still uses the first.
    auto socket = server.accept();
    for (int i = 0; i < 50; ++i) {
        connection->send(bytesOf("late"));
        std::this_thread::sleep_for(2ms);
    }
    ASSERT_TRUE(isNext<Connection::Lost>(*connection));
    connection->send(bytesOf("late"));
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    connection->send(bytesOf("hello"));
    EXPECT_EQ(read(socket), "hello");
}

TEST(WebSocketConnection, ResetMakesANewOne) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto first = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    connection->reset();
    connection->reset();
    ASSERT_TRUE(isNext<Connection::Lost>(*connection));
    auto second = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
}

TEST(WebSocketConnection, ReportsThatNoServerAnswersAndKeepsTrying) {
    std::uint16_t port = 0;
    {
        port = SmallServer().port();
    }
    const auto connection = client::createWebSocketConnection({"127.0.0.1", port, ""});
    const auto happening = next(*connection);
    ASSERT_TRUE(happening && std::holds_alternative<Connection::Lost>(*happening));
    const Error& reason = std::get<Connection::Lost>(*happening).reason;
    EXPECT_EQ(reason.code, ErrorCode::NotConnected);
    EXPECT_EQ(reason.message, "cannot reach ws://127.0.0.1:" + std::to_string(port) +
                                  ": Connection refused. Is `usdlive serve` running there?");
    SmallServer server(port);
    auto socket = server.accept();
    for (auto happened = next(*connection); happened; happened = next(*connection))
        if (std::holds_alternative<Connection::Opened>(*happened)) return;
    FAIL() << "not opened";
}

TEST(WebSocketConnection, ReportsThatTheServerIsAnotherOne) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.acceptTcp();
    asio::write(socket,
                asio::buffer(std::string("HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")));
    const auto happening = next(*connection);
    ASSERT_TRUE(happening && std::holds_alternative<Connection::Lost>(*happening));
    EXPECT_NE(std::get<Connection::Lost>(*happening).reason.message.find("HTTP 404"),
              std::string::npos);
}

TEST(WebSocketConnection, LeavesInOrderAndSendsQueuedMessages) {
    SmallServer server;
    auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    connection->send(bytesOf("last words"));
    auto closed = std::async(std::launch::async, [&] { connection.reset(); });
    EXPECT_EQ(read(socket), "last words");
    EXPECT_EQ(codeOfRead(socket), "The WebSocket stream was gracefully closed at both endpoints");
    EXPECT_EQ(closed.wait_for(400ms), std::future_status::ready);
}

TEST(WebSocketConnection, LeavesAPeerThatDoesNotAnswer) {
    SmallServer server;
    auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    const auto start = std::chrono::steady_clock::now();
    connection.reset();
    EXPECT_LT(std::chrono::steady_clock::now() - start, 2s);
}

// The peer receives and does not answer; the pings notice this. Only one test does this, because it
// is slow.
TEST(WebSocketConnection, NoticesADeadPeer) {
    SmallServer server;
    const auto connection = client::createWebSocketConnection(server.address());
    auto socket = server.accept();
    ASSERT_TRUE(isNext<Connection::Opened>(*connection));
    const auto start = std::chrono::steady_clock::now();
    ASSERT_TRUE(connection->wait(15s));
    EXPECT_TRUE(isNext<Connection::Lost>(*connection));
    EXPECT_GT(std::chrono::steady_clock::now() - start, 4s);
}
