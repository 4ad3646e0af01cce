// Fuzzes the port: an HTTP request and, if it became a session, WebSocket frames. The server is the
// real one, on loopback, run step by step.
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <filesystem>
#include <string>

#include "Fuzz.h"
#include "transport/FileRequest.h"
#include "transport/HttpServer.h"
#include "usdlive/common/protocol/Frame.h"

using namespace usdlive;
using namespace usdlive::server;
using namespace std::chrono_literals;
namespace asio = boost::asio;
namespace fs = std::filesystem;
using asio::ip::tcp;
using fuzz::require;

namespace {

struct NoLog final : Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override {}
};

struct Zeros final : HttpContent {
    std::uint64_t size() const override { return 1'000; }
    Result<void> read(std::uint64_t offset, std::span<std::uint8_t> part) override {
        require(offset + part.size() <= size(), "only existing bytes are read");
        return {};
    }
};

/// Echoes each message; a message without frames ends the session.
class World final : public SessionHandler {
public:
    World() {
        WebSocketOptions options;
        options.maxMessageBytes = 4096;
        auto background = [this](std::function<void()> job) { asio::post(io, std::move(job)); };
        sessions = createWebSocketTransport(io, options, *this, background, log);
        HttpServerOptions httpOptions;
        httpOptions.allowedOrigins = {"https://friend"};
        const auto router = [this](const HttpTarget& target) -> HttpRoute {
            const std::string_view path = target.path;
            if (path == "/live") return HttpSessions{sessions.get()};
            if (path == "/healthz")
                return HttpPage(
                    [](const HttpAnswer& answer) { answer({"application/json", "{}"}); });
            if (path.starts_with("/files")) return files(target);
            return HttpReply{"text/plain", "there is nothing here\n", 404};
        };
        server = std::move(*createHttpServer(io, httpOptions, router, log));
    }

    /// Checks what the parser accepts, and sends a content.
    HttpRoute files(const HttpTarget& target) {
        const auto request =
            parseFileRequest(target.path.substr(std::string_view("/files").size()), target.query);
        if (!request) return HttpReply{"text/plain", request.error().message, 400};
        const fs::path path = request->path;
        require(path.is_relative() && path.lexically_normal() == path,
                "AS2: a path in the project");
        for (const fs::path& part : path)
            require(!part.native().starts_with('.'), "AS2: nothing hidden");
        return HttpPage([this](const HttpAnswer& answer) {
            HttpReply reply{"application/octet-stream", {}};
            reply.etag = "mark";
            reply.content = std::make_shared<Zeros>();
            reply.background = [this](std::function<void()> job) {
                asio::post(io, std::move(job));
            };
            answer(reply);
        });
    }

    void opened(SessionId, const std::optional<SignedIn>&) override { ++open; }
    void received(SessionId session, ByteView message) override {
        require(open > 0, "a message belongs to a session");
        if (const auto frames = splitMessage(message); !frames)
            return sessions->close(session, frames.error());
        sessions->send(session, std::make_shared<const Bytes>(message.begin(), message.end()));
    }
    void closed(SessionId) override { --open; }
    void drained(SessionId) override {}

    asio::io_context io;
    NoLog log;
    int open = 0;
    std::shared_ptr<WebSocketTransport> sessions;
    std::unique_ptr<HttpServer> server;
};

/// Returns everything that has arrived.
std::string arrived(tcp::socket& socket) {
    std::string all;
    boost::system::error_code error;
    while (!error) {
        char some[4096];
        all.append(some, socket.read_some(asio::buffer(some), error));
    }
    return all;
}

void checkAnswer(const std::string& answer, std::string_view request) {
    if (answer.empty()) return;
    const std::string line = answer.substr(0, answer.find("\r\n"));
    static const std::vector<std::string> kLines{"HTTP/1.1 101 Switching Protocols",
                                                 "HTTP/1.1 200 OK",
                                                 "HTTP/1.1 206 Partial Content",
                                                 "HTTP/1.1 304 Not Modified",
                                                 "HTTP/1.1 416 Range Not Satisfiable",
                                                 "HTTP/1.1 400 Bad Request",
                                                 "HTTP/1.1 403 Forbidden",
                                                 "HTTP/1.1 404 Not Found",
                                                 "HTTP/1.1 405 Method Not Allowed",
                                                 "HTTP/1.1 426 Upgrade Required",
                                                 "HTTP/1.1 431 Request Header Fields Too Large"};
    require(std::count(kLines.begin(), kLines.end(), line) == 1,
            "the answer is one of the known ones");
    if (line == kLines[0])
        require(request.starts_with("GET /live"), "a session begins at /live only");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static World world;
    const std::string_view input = asText({data, size}), end = "\r\n\r\n";
    const std::string_view request = input.substr(0, input.find(end) + end.size());

    tcp::socket client(world.io);
    boost::system::error_code error;
    client.connect({asio::ip::address_v4::loopback(), world.server->port()}, error);
    if (error) return 0;  // libFuzzer's timer interrupts
    client.non_blocking(true);
    const auto send = [&](std::string_view bytes) {
        asio::write(client, asio::buffer(bytes), error);
        world.io.poll();
    };
    send(request);
    const std::string answer = arrived(client);
    checkAnswer(answer, request);
    if (answer.starts_with("HTTP/1.1 101")) send(input.substr(request.size()));
    client.set_option(asio::socket_base::linger(true, 0), error);  // keeps no port busy afterwards
    client.close(error);
    while (world.server->counters().connections != 0)
        require(world.io.run_one_for(20s) != 0, "the server notices a closed connection");
    world.io.poll();
    require(world.open == 0, "the end of each session is reported");
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    const std::string upgrade =
        "GET /live HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    const auto frame = [](char first, std::string_view content) {
        std::string bytes{first, char(0x80 | content.size()), 1, 2, 3, 4};  // the mask
        for (std::size_t at = 0; at < content.size(); ++at)
            bytes += char(content[at] ^ (at % 4 + 1));
        return bytes;
    };
    const std::string message("\x10\0\0\0sixteen of bytes", 20);
    std::vector<Bytes> all;
    for (const std::string& input :
         {std::string("GET /files/tex/a%20b.png?hash=00 HTTP/1.1\r\nRange: bytes=1-2\r\n\r\n"),
          std::string("HEAD /files?revision=12&checkpoint=a HTTP/1.1\r\nIf-None-Match: *\r\n\r\n"),
          std::string("GET /files/%2E%2E/a HTTP/1.1\r\nRange: bytes=-5\r\nIf-Range: a\r\n\r\n"),
          std::string("GET /healthz HTTP/1.1\r\n\r\n"), std::string("POST /live HTTP/1.1\r\n\r\n"),
          std::string("GET /live?a=b HTTP/1.0\r\nContent-Length: 9\r\n\r\nx"),
          std::string("GET /nowhere HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n"),
          upgrade + "\r\n" + frame('\x82', message), upgrade + "Origin: https://friend\r\n\r\n",
          upgrade + "Origin: http://evil\r\n\r\n", upgrade + "\r\n" + frame('\x81', "text"),
          upgrade + "\r\n" + frame('\x02', message) + frame('\x89', "ping") +
              frame('\x80', message),
          upgrade + "\r\n" +
              frame('\x88',
                    "\x03\xE8"
                    "bye"),
          upgrade + "\r\n" + frame('\x82', "no"),
          upgrade + "Sec-WebSocket-Extensions: permessage-deflate\r\n\r\n" +
              frame('\xC2', message)})
        all.push_back(copyOf(asBytes(input)));
    return all;
}
