// Runs the product's WebSocket server with an application that echoes all messages, also text. Used
// only by the conformance suite. Prints its port.

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <iostream>

#include "transport/HttpServer.h"

namespace {

using namespace usdlive;
using namespace usdlive::server;

class Echo final : public SessionHandler {
public:
    explicit Echo(boost::asio::io_context& network) : network_(network) {}

    void opened(SessionId, const std::optional<SignedIn>&) override {}
    // Reads the next message in the next turn, when the answer is on its way: the suite wants an
    // answer for each message, also before a frame that ends the session.
    void received(SessionId session, ByteView message) override {
        server->send(session, std::make_shared<const Bytes>(message.begin(), message.end()));
        server->setReading(session, false);
        boost::asio::post(network_, [this, session] { server->setReading(session, true); });
    }
    void closed(SessionId) override {}
    void drained(SessionId) override {}

    WebSocketTransport* server = nullptr;

private:
    boost::asio::io_context& network_;
};

class NoLog final : public Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override {}
};

}  // namespace

int main() {
    boost::asio::io_context network(1);
    Echo echo(network);
    NoLog log;
    WebSocketOptions options;
    options.maxHelloBytes = options.maxMessageBytes;  // there is no hello
    options.takesText = true;
    const auto sessions = createWebSocketTransport(
        network, options, echo, [](const std::function<void()>& job) { job(); }, log);
    const auto server = createHttpServer(
        network, {}, [&](auto) -> HttpRoute { return HttpSessions{sessions.get()}; }, log);
    if (!server) {
        std::cerr << server.error().message << '\n';
        return 1;
    }
    echo.server = sessions.get();
    std::cout << (*server)->port() << std::endl;
    network.run();
}
