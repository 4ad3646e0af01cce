// Tests the HTTP and WebSocket server over real sockets.
#include "transport/HttpServer.h"

#include <gmock/gmock.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/read_until.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <condition_variable>
#include <filesystem>
#include <future>
#include <mutex>
#include <thread>

#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

using namespace usdlive;
using namespace usdlive::server;
using namespace std::chrono_literals;
namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;
using testing::StartsWith;

namespace {

class SilentLog final : public Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override {}
};

/// Records the server's calls, and lets other threads wait for them.
class Recorder final : public SessionHandler {
public:
    void opened(SessionId session, const std::optional<SignedIn>&) override {
        note([&] { opened_.push_back(session); });
    }
    void received(SessionId session, ByteView message) override {
        if (asText(message) == "throw") throw std::logic_error("a bug");
        note([&] { messages_[session].emplace_back(asText(message)); });
    }
    void closed(SessionId session) override {
        note([&] { closed_.push_back(session); });
    }
    void drained(SessionId session) override {
        note([&] { drained_.push_back(session); });
    }

    bool waitDrained(SessionId session) {
        return wait([&] { return std::count(drained_.begin(), drained_.end(), session) > 0; });
    }
    SessionId session(std::size_t index) {
        return wait([&] { return opened_.size() > index; }) ? opened_[index] : 0;
    }
    std::vector<std::string> messages(SessionId session, std::size_t count) {
        wait([&] { return messages_[session].size() >= count; });
        const std::lock_guard lock(mutex_);
        return messages_[session];
    }
    std::size_t closedTimes(SessionId session) {
        const std::lock_guard lock(mutex_);
        return std::size_t(std::count(closed_.begin(), closed_.end(), session));
    }
    bool waitClosed(SessionId session, std::chrono::milliseconds time = 10s) {
        return wait([&] { return std::count(closed_.begin(), closed_.end(), session) > 0; }, time);
    }

private:
    template <class Change>
    void note(Change change) {
        const std::lock_guard lock(mutex_);
        change();
        changed_.notify_all();
    }
    template <class Condition>
    bool wait(Condition condition, std::chrono::milliseconds time = 10s) {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, time, condition);
    }

    std::mutex mutex_;
    std::condition_variable changed_;
    std::vector<SessionId> opened_, closed_, drained_;
    std::map<SessionId, std::vector<std::string>> messages_;
};

SharedBytes shared(std::string_view text) {
    const ByteView bytes = asBytes(text);
    return std::make_shared<const Bytes>(bytes.begin(), bytes.end());
}

/// A content of known bytes, which can fail from a position on.
class Pattern final : public HttpContent {
public:
    explicit Pattern(std::uint64_t size, std::uint64_t failsAt = ~std::uint64_t(0))
        : size_(size), failsAt_(failsAt) {}
    std::uint64_t size() const override { return size_; }
    Result<void> read(std::uint64_t offset, std::span<std::uint8_t> part) override {
        if (offset + part.size() > failsAt_) return fail(ErrorCode::Internal, "it was changed");
        for (std::uint8_t& byte : part) byte = at(offset++);
        return {};
    }
    static std::uint8_t at(std::uint64_t offset) { return std::uint8_t(offset * 31 / 7); }
    static std::string text(std::uint64_t begin, std::uint64_t end) {
        std::string text;
        for (; begin < end; ++begin) text += char(at(begin));
        return text;
    }

private:
    const std::uint64_t size_, failsAt_;
};

class HttpServerTest : public testing::Test {
protected:
    void start(WebSocketOptions options = {}, HttpServerOptions httpOptions = {}) {
        server_ = createWebSocketTransport(io_, options, recorder_, background(), log_);
        auto created = createHttpServer(
            io_, std::move(httpOptions),
            [this](const HttpTarget& target) { return route(target.path); }, log_);
        ASSERT_TRUE(created) << created.error().message;
        http_ = std::move(*created);
        port_ = http_->port();
        thread_ = std::thread([this] { io_.run(); });
    }

    HttpRoute route(std::string_view path) {
        if (path == "/live") return HttpSessions{server_.get()};
        if (path == "/healthz")
            return HttpPage([](const HttpAnswer& answer) {
                answer({"application/json", "{\"status\":\"ok\"}"});
                answer({"text/plain", "a second answer is ignored"});
            });
        if (path == "/broken")
            return HttpPage([](const HttpAnswer&) { throw std::runtime_error("no"); });
        if (path == "/later")
            return HttpPage([this](const HttpAnswer& answer) {
                workers_.emplace_back([answer] { answer({"text/plain", "from another thread"}); });
            });
        if (path == "/never") return HttpPage([](const HttpAnswer&) {});
        if (path == "/again" && !isFetched_)
            return HttpAgain{[this](std::function<void()> ready) {
                workers_.emplace_back([this, ready] {
                    isFetched_ = true;
                    ready();
                    ready();  // the second call is ignored
                });
            }};
        if (path == "/again") return HttpReply{"text/plain", "it was fetched"};
        if (path == "/always%20again")
            return HttpAgain{[](const std::function<void()>& ready) { ready(); }};
        if (path == "/never%20again") return HttpAgain{[](const std::function<void()>&) {}};
        if (path == "/content")
            return HttpPage([this](const HttpAnswer& answer) {
                HttpReply reply{"application/octet-stream", {}};
                reply.etag = "mark";
                reply.content = content_;
                reply.background = background();
                answer(reply);
            });
        if (path == "/compressible" || path == "/incompressible")
            return HttpPage([this, pays = path == "/compressible"](const HttpAnswer& answer) {
                HttpReply reply{"application/octet-stream", {}};
                reply.etag = "mark";
                reply.content = content_;
                reply.background = background();
                reply.compressed = [pays]() -> std::shared_ptr<HttpContent> {
                    return pays ? std::make_shared<Pattern>(99) : nullptr;
                };
                answer(reply);
            });
        return HttpReply{"text/plain", "there is nothing here\n", 404};
    }

    ~HttpServerTest() override {
        asio::post(io_, [this] {
            http_.reset();
            server_.reset();
        });
        work_.reset();
        if (thread_.joinable()) thread_.join();
        for (auto& worker : workers_) worker.join();
    }

    Background background() {
        return [this](std::function<void()> job) { workers_.emplace_back(std::move(job)); };
    }

    /// Calls the server on its thread. That thread must not wait for its own records.
    template <class Function>
    auto onServer(Function function) {
        using Task = std::packaged_task<decltype(function(*server_))()>;
        const auto task = std::make_shared<Task>([&] { return function(*server_); });
        auto result = task->get_future();
        asio::post(io_, [task] { (*task)(); });
        return result.get();
    }

    tcp::socket connect(int receiveBuffer = 0) {
        tcp::socket socket(clientIo_);
        socket.open(tcp::v4());
        if (receiveBuffer) socket.set_option(asio::socket_base::receive_buffer_size(receiveBuffer));
        socket.connect({asio::ip::address_v4::loopback(), port_});
        return socket;
    }

    /// Returns everything that the server answers to a request until it closes the connection.
    std::string http(const std::string& request) {
        tcp::socket socket = connect();
        beast::error_code error;
        asio::write(socket, asio::buffer(request), error);
        std::string answer;
        asio::read(socket, asio::dynamic_buffer(answer), error);
        return answer;
    }

    struct Client {
        explicit Client(tcp::socket socket) : stream(std::move(socket)) { stream.binary(true); }
        websocket::stream<tcp::socket> stream;

        void send(std::string_view text) { stream.write(asio::buffer(text)); }
        std::string read() {
            beast::flat_buffer buffer;
            beast::error_code error;
            stream.read(buffer, error);
            if (error) return "";
            const auto data = buffer.data();
            return {static_cast<const char*>(data.data()), data.size()};
        }
        /// Reads the error message in the only frame of the next message.
        ErrorMessage readError() {
            const std::string message = read();
            const auto frames = splitMessage(asBytes(message));
            if (!frames || frames->size() != 1) return {};
            const auto frame = decodeFrame(frames->front());
            const auto* control = frame ? std::get_if<ControlFrame>(&*frame) : nullptr;
            const auto decoded = control ? decodeControl(control->json) : fail(ErrorCode{}, "none");
            const auto* error = decoded ? std::get_if<ErrorMessage>(&*decoded) : nullptr;
            return error ? *error : ErrorMessage{};
        }
        /// Returns the code with which the server closed; 0 if it did not.
        unsigned closeCode() {
            while (!read().empty()) continue;
            return stream.reason().code;
        }
    };

    std::unique_ptr<Client> join(int receiveBuffer = 0, const std::string& origin = {}) {
        auto client = std::make_unique<Client>(connect(receiveBuffer));
        if (!origin.empty())
            client->stream.set_option(websocket::stream_base::decorator(
                [origin](auto& request) { request.set("Origin", origin); }));
        client->stream.handshake("127.0.0.1", "/live");
        recorder_.session(
            joined_++);  // the server may notice the session a little later than the client
        return client;
    }

    SilentLog log_;
    Recorder recorder_;
    asio::io_context io_{1}, clientIo_;
    asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
    std::shared_ptr<WebSocketTransport> server_;
    std::unique_ptr<HttpServer> http_;
    std::thread thread_;
    std::atomic<bool> isFetched_ = false;
    std::vector<std::thread> workers_;  // one for each job
    std::uint16_t port_ = 0;
    std::size_t joined_ = 0;
    std::shared_ptr<HttpContent> content_ = std::make_shared<Pattern>(1'000);
};

TEST_F(HttpServerTest, AnswersHttpRoutes) {
    start();
    const std::string answer = http("GET /healthz?x=1 HTTP/1.1\r\nHost: x\r\n\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 OK\r\n"));
    EXPECT_THAT(answer, HasSubstr("Content-Type: application/json"));
    EXPECT_THAT(answer, HasSubstr("\r\n\r\n{\"status\":\"ok\"}"));
}

std::string bodyOf(const std::string& answer) { return answer.substr(answer.find("\r\n\r\n") + 4); }

TEST_F(HttpServerTest, AS3SendsAContentOfManyParts) {
    constexpr std::uint64_t kSize = 3'000'001;
    content_ = std::make_shared<Pattern>(kSize);
    start();
    const std::string answer = http("GET /content HTTP/1.1\r\n\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
    EXPECT_THAT(answer, HasSubstr("Content-Length: 3000001\r\n"));
    EXPECT_THAT(answer, HasSubstr("ETag: \"mark\"\r\n"));
    EXPECT_EQ(bodyOf(answer), Pattern::text(0, kSize));
    const std::string head = http("HEAD /content HTTP/1.1\r\n\r\n");
    EXPECT_THAT(head, HasSubstr("Content-Length: 3000001\r\n"));
    EXPECT_EQ(bodyOf(head), "");
}

TEST_F(HttpServerTest, AS3SendsRangesOfAContent) {
    start();
    const auto ranged = [&](const std::string& headers) {
        return http("GET /content HTTP/1.1\r\n" + headers + "\r\n");
    };
    const std::map<std::string, std::pair<std::uint64_t, std::uint64_t>> kRanges{
        {"0-0", {0, 1}},       {"10-19", {10, 20}},   {"990-", {990, 1'000}},
        {"-10", {990, 1'000}}, {"-5000", {0, 1'000}}, {"500-99999999999999999999", {500, 1'000}}};
    for (const auto& [text, range] : kRanges) {
        const std::string answer = ranged("Range: bytes=" + text + "\r\n");
        EXPECT_THAT(answer, StartsWith("HTTP/1.1 206")) << text;
        EXPECT_THAT(answer, HasSubstr("Content-Range: bytes " + std::to_string(range.first) + "-" +
                                      std::to_string(range.second - 1) + "/1000\r\n"));
        EXPECT_EQ(bodyOf(answer), Pattern::text(range.first, range.second)) << text;
    }
    const std::string beyond = ranged("Range: bytes=1000-\r\n");
    EXPECT_THAT(beyond, StartsWith("HTTP/1.1 416"));
    EXPECT_THAT(beyond, HasSubstr("Content-Range: bytes */1000\r\n"));
    for (const std::string other :
         {"bytes=9-1", "bytes=a-b", "bytes=-", "bytes=1-2,4-5", "lines=1-2"})
        EXPECT_EQ(bodyOf(ranged("Range: " + other + "\r\n")), Pattern::text(0, 1'000)) << other;
    EXPECT_THAT(ranged("Range: bytes=1-2\r\nIf-Range: \"mark\"\r\n"), StartsWith("HTTP/1.1 206"));
    EXPECT_THAT(ranged("Range: bytes=1-2\r\nIf-Range: \"old\"\r\n"), StartsWith("HTTP/1.1 200"));
    const std::string same = ranged("If-None-Match: \"x\", \"mark\"\r\n");
    EXPECT_THAT(same, StartsWith("HTTP/1.1 304"));
    EXPECT_EQ(bodyOf(same), "");
}

TEST_F(HttpServerTest, AS5CompressesForThoseWhoAcceptIt) {
    start();
    const auto get = [&](const std::string& headers, const std::string& of = "compressible",
                         const std::string& method = "GET") {
        return http(method + " /" + of + " HTTP/1.1\r\n" + headers + "\r\n");
    };
    for (const std::string accepted : {"zstd", "gzip, ZSTD;q=0.5", "zstd;q=0.001, identity"}) {
        const std::string answer = get("Accept-Encoding: " + accepted + "\r\n");
        EXPECT_THAT(answer, StartsWith("HTTP/1.1 200")) << accepted;
        EXPECT_THAT(answer, HasSubstr("Content-Encoding: zstd\r\n")) << accepted;
        EXPECT_THAT(answer, HasSubstr("ETag: \"mark-zstd\"\r\n"));
        EXPECT_THAT(answer, HasSubstr("Vary: Accept-Encoding\r\n"));
        EXPECT_EQ(bodyOf(answer), Pattern::text(0, 99));
    }
    const auto isPlain = [](const std::string& answer) {
        EXPECT_THAT(answer, HasSubstr("ETag: \"mark\"\r\n"));
        EXPECT_THAT(answer, HasSubstr("Vary: Accept-Encoding\r\n"));
        EXPECT_EQ(answer.find("Content-Encoding"), std::string::npos);
        return bodyOf(answer);
    };
    for (const std::string refused :
         {"", "Accept-Encoding: gzip, br\r\n", "Accept-Encoding: zstd;q=0\r\n",
          "Accept-Encoding: zstd;q=0.000, *;q=0\r\n"})
        EXPECT_EQ(isPlain(get(refused)), Pattern::text(0, 1'000)) << refused;
    const std::string zstd = "Accept-Encoding: zstd\r\n";
    EXPECT_EQ(isPlain(get(zstd, "incompressible")), Pattern::text(0, 1'000));
    EXPECT_EQ(isPlain(get(zstd, "compressible", "HEAD")), "");
    EXPECT_EQ(isPlain(get(zstd + "Range: bytes=10-19\r\n")), Pattern::text(10, 20));
    for (const char* known : {"mark", "mark-zstd"})
        for (const auto& accepted : {std::string(), zstd})
            EXPECT_THAT(get(accepted + "If-None-Match: \"" + known + "\"\r\n"),
                        StartsWith("HTTP/1.1 304"));
    EXPECT_THAT(get(zstd + "If-None-Match: \"other-zstd\"\r\n"), StartsWith("HTTP/1.1 200"));
}

TEST_F(HttpServerTest, AS3AContentThatCannotBeReadIsCutOff) {
    content_ = std::make_shared<Pattern>(2'000'000, 1'500'000);
    start();
    const std::string answer = http("GET /content HTTP/1.1\r\n\r\n");
    EXPECT_THAT(answer, HasSubstr("Content-Length: 2000000\r\n"));
    EXPECT_LT(bodyOf(answer).size(), 2'000'000U);
}

TEST_F(HttpServerTest, SendsAnEmptyContent) {
    content_ = std::make_shared<Pattern>(0);
    start();
    EXPECT_THAT(http("GET /content HTTP/1.1\r\n\r\n"), HasSubstr("Content-Length: 0\r\n"));
}

TEST_F(HttpServerTest, AnswersLaterOrReportsATimeout) {
    HttpServerOptions options;
    options.headerTime = 400ms;  // also the interval of its checks
    options.answerTime = 200ms;
    start({}, options);
    EXPECT_THAT(http("GET /later HTTP/1.1\r\nHost: x\r\n\r\n"),
                HasSubstr("\r\n\r\nfrom another thread"));
    EXPECT_THAT(http("GET /never HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 503"));
}

TEST_F(HttpServerTest, AC24ARequestWaitsForWhatTheRouterNeeds) {
    HttpServerOptions options;
    options.headerTime = 400ms;
    options.answerTime = 200ms;
    start({}, options);
    EXPECT_THAT(http("GET /again HTTP/1.1\r\nHost: x\r\n\r\n"),
                HasSubstr("\r\n\r\nit was fetched"));
    EXPECT_THAT(http("GET /again HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 200"));
    for (const char* path : {"/always%20again", "/never%20again"})
        EXPECT_THAT(http("GET " + std::string(path) + " HTTP/1.1\r\nHost: x\r\n\r\n"),
                    StartsWith("HTTP/1.1 503"));
}

TEST_F(HttpServerTest, RefusesOtherHttp) {
    start();
    EXPECT_THAT(http("GET / HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 404"));
    EXPECT_THAT(http("GET /live HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 426"));
    EXPECT_THAT(http("GET /broken HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 500"));
    EXPECT_THAT(http("nonsense\r\n\r\n"), StartsWith("HTTP/1.1 400"));
    EXPECT_THAT(http("POST /nowhere HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 404"));
    const std::string post =
        http("POST /healthz HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\n\r\nbody");
    EXPECT_THAT(post, StartsWith("HTTP/1.1 405"));
    EXPECT_THAT(post, HasSubstr("\r\nAllow: GET, HEAD\r\n"));
}

TEST_F(HttpServerTest, RefusesLargeHeaders) {
    start();
    EXPECT_THAT(
        http("GET /healthz HTTP/1.1\r\nHost: x\r\nX: " + std::string(25'000, 'x') + "\r\n\r\n"),
        StartsWith("HTTP/1.1 431"));
}

TEST_F(HttpServerTest, HangsUpOnHeadersThatTakeTooLong) {
    HttpServerOptions options;
    options.headerTime = 200ms;
    start({}, options);
    tcp::socket socket = connect();
    const auto begin = std::chrono::steady_clock::now();
    asio::write(socket, asio::buffer(std::string("GET /heal")));
    char byte;
    beast::error_code error;
    asio::read(socket, asio::buffer(&byte, 1), error);
    EXPECT_TRUE(error);
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 2s);
    EXPECT_THAT(http("GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 200"));
}

TEST_F(HttpServerTest, SE16ASilentConnectionGivesWayToANewcomer) {
    HttpServerOptions options;
    options.seats.guests = 1;
    options.seats.patience = 50ms;
    start({}, options);
    const auto member = join();
    member->send("hello");
    recorder_.messages(recorder_.session(0), 1);
    std::vector<tcp::socket> silent;
    for (int count = 0; count < 5; ++count) silent.push_back(connect());
    const auto stopsAfterUpgrade = join();
    EXPECT_THAT(http("GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 200"));
    EXPECT_TRUE(recorder_.waitClosed(recorder_.session(1)));
    EXPECT_EQ(recorder_.closedTimes(recorder_.session(0)), 0u);
    const auto counters = onServer([this](auto&) { return http_->counters(); });
    EXPECT_EQ(counters.turnedAway, 6u);
}

TEST_F(HttpServerTest, SE16ASessionSaysHelloInTime) {
    WebSocketOptions options;
    options.greetTime = 1s;
    options.slowReaderTime = 400ms;  // looks for it every 100 ms
    start(options);
    const auto speaks = join();
    speaks->send("hello");
    const auto silent = join();
    EXPECT_EQ(silent->readError().code, "notGreeted");
    EXPECT_TRUE(recorder_.waitClosed(recorder_.session(1)));
    EXPECT_EQ(recorder_.closedTimes(recorder_.session(0)), 0u);
}

TEST_F(HttpServerTest, FR20TheFirstMessageIsSmall) {
    WebSocketOptions options;
    options.maxHelloBytes = 1000;
    start(options);
    const auto first = join(), second = join();
    first->send(std::string(1000, 'x'));
    first->send(std::string(100'000, 'x'));
    EXPECT_EQ(recorder_.messages(recorder_.session(0), 2).size(), 2u);
    second->send(std::string(1001, 'x'));
    EXPECT_EQ(second->readError().code, "frameTooLarge");
}

TEST_F(HttpServerTest, SE16TheRestOfAMessageArrivesInTime) {
    WebSocketOptions options;
    options.messageTime = 100ms;
    options.slowReaderTime = 400ms;
    start(options);
    const auto client = join();
    client->send("hello");
    client->stream.write_some(false, asio::buffer(std::string("a part")));
    EXPECT_EQ(client->readError().code, "malformedFrame");
}

TEST_F(HttpServerTest, HO1AnswersForItsOwnHostsOnly) {
    HttpServerOptions options;
    options.hosts = HostNames({"workstation"});
    start({}, options);
    const auto get = [this](const std::string& host) {
        return http("GET /healthz HTTP/1.1\r\n" + host + "\r\n");
    };
    for (const char* host : {"Host: workstation:7447\r\n", "Host: 127.0.0.1\r\n", ""})
        EXPECT_THAT(get(host), StartsWith("HTTP/1.1 200")) << host;
    EXPECT_THAT(get("Host: evil.example:7447\r\n"),
                AllOf(StartsWith("HTTP/1.1 421"), HasSubstr("--allow-host evil.example")));
    EXPECT_THAT(get("Host: a b\r\n"), StartsWith("HTTP/1.1 400"));
    Client page(connect());
    EXPECT_THROW(page.stream.handshake("evil.example", "/live"), beast::system_error);
}

TEST_F(HttpServerTest, RefusesPagesOfForeignOrigins) {
    HttpServerOptions options;
    options.allowedOrigins = {"https://studio.example"};
    start({}, options);
    EXPECT_THROW(join(0, "https://evil.example"), beast::system_error);
    EXPECT_NO_THROW(join(0, "https://studio.example"));
}

TEST_F(HttpServerTest, HO2RefusesRequestsOfForeignPages) {
    HttpServerOptions options;
    options.allowedOrigins = {"https://studio.example"};
    start({}, options);
    const auto status = [&](const std::string& headers) {
        return http("GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:7\r\n" + headers + "\r\n")
            .substr(9, 3);
    };
    EXPECT_EQ(status(""), "200");
    EXPECT_EQ(status("Origin: https://evil.example\r\n"), "403");
    EXPECT_EQ(status("Origin: null\r\n"), "403");
    EXPECT_EQ(status("Origin: https://studio.example\r\n"), "200");
    // The server's own pages. Another port is another origin.
    EXPECT_EQ(status("Origin: http://127.0.0.1:7\r\n"), "200");
    EXPECT_EQ(status("Origin: http://127.0.0.1:8\r\n"), "403");
    EXPECT_EQ(status("Origin: https://127.0.0.1:7\r\n"), "403");
    for (const std::string site : {"cross-site", "same-site"}) {
        EXPECT_EQ(status("Sec-Fetch-Site: " + site + "\r\nSec-Fetch-Mode: no-cors\r\n"), "403");
        EXPECT_EQ(status("Sec-Fetch-Site: " + site + "\r\n"), "403");
        EXPECT_EQ(status("Sec-Fetch-Site: " + site + "\r\nSec-Fetch-Mode: navigate\r\n"), "200");
    }
    for (const std::string site : {"none", "same-origin"})
        EXPECT_EQ(status("Sec-Fetch-Site: " + site + "\r\nSec-Fetch-Mode: no-cors\r\n"), "200");
}

TEST_F(HttpServerTest, SaysThatThePortIsInUse) {
    start();
    HttpServerOptions options;
    options.port = port_;
    const auto second = createHttpServer(io_, options, {}, log_);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::InvalidConfiguration);
    EXPECT_EQ(second.error().message,
              "cannot listen at 127.0.0.1:" + std::to_string(port_) + ": Address already in use");
}

TEST_F(HttpServerTest, PassesOnMessagesAndReportsOpenAndClose) {
    start();
    const auto client = join();
    const SessionId session = recorder_.session(0);
    client->send("one");
    client->send(std::string(300'000, 'x'));
    client->send("three");
    EXPECT_THAT(recorder_.messages(session, 3),
                testing::ElementsAre("one", std::string(300'000, 'x'), "three"));
    client->stream.close(websocket::close_code::normal);
    EXPECT_TRUE(recorder_.waitClosed(session));
    EXPECT_EQ(recorder_.closedTimes(session), 1u);
}

TEST_F(HttpServerTest, SendsAllOfATurnAsOneMessageInOrder) {
    start();
    const auto client = join();
    const SessionId session = recorder_.session(0);
    std::string expected;
    std::vector<SharedBytes> frames;
    for (int frame = 0; frame < 500; ++frame) {
        // Small messages, which are joined, and large ones, which are not.
        frames.push_back(shared(std::to_string(frame) + std::string(frame % 7 ? 10 : 2000, '.')));
        expected += asText(*frames.back());
    }
    onServer([&](auto& server) {
        for (const auto& frame : frames) server.send(session, frame);
    });
    EXPECT_EQ(client->read(), expected);
    // The client may receive it before the server is notified that it was sent.
    auto counters = onServer([](auto& server) { return server.counters(); });
    for (int turn = 0; turn < 1000 && counters.queuedBytes > 0; ++turn) {
        std::this_thread::sleep_for(1ms);
        counters = onServer([](auto& server) { return server.counters(); });
    }
    EXPECT_EQ(counters.framesOut, 500u);
    EXPECT_EQ(counters.messagesOut, 1u);
    EXPECT_EQ(counters.bytesOut, expected.size());
    EXPECT_EQ(counters.queuedBytes, 0u);
}

// Nagle's algorithm would delay a small commit until the one before is acknowledged (40 ms).
TEST_F(HttpServerTest, SessionsHaveNoDelay) {
    start();
    const auto client = join();
    const auto local = client->stream.next_layer().local_endpoint();
    // The server is in this process: its socket is the descriptor whose peer is the client.
    int found = 0;
    for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
        const int descriptor = std::stoi(entry.path().filename());
        tcp::endpoint peer;
        socklen_t size = peer.capacity();
        if (::getpeername(descriptor, peer.data(), &size) != 0 || peer != local) continue;
        int noDelay = 0;
        size = sizeof noDelay;
        ASSERT_EQ(::getsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &noDelay, &size), 0);
        EXPECT_NE(noDelay, 0);
        ++found;
    }
    EXPECT_EQ(found, 1);
}

TEST_F(HttpServerTest, SendsOneLargeFrameCompletely) {
    start();
    const auto client = join();
    const SharedBytes large = shared(std::string(5 << 20, 'x') + "end");
    const SessionId session = recorder_.session(0);
    onServer([&](auto& server) { server.send(session, large); });
    EXPECT_EQ(client->read(), asText(*large));
}

TEST_F(HttpServerTest, TextIsAnsweredWithAnErrorAndClosed) {
    start();
    const auto client = join();
    client->stream.text(true);
    client->send("hello");
    const ErrorMessage error = client->readError();
    EXPECT_EQ(error.code, "textFrame");
    EXPECT_TRUE(error.closing);
    EXPECT_EQ(client->closeCode(), websocket::close_code::unknown_data);
    EXPECT_TRUE(recorder_.waitClosed(recorder_.session(0)));
    EXPECT_EQ(recorder_.messages(recorder_.session(0), 0).size(), 0u);
}

TEST_F(HttpServerTest, ATooLargeMessageIsAnsweredWithAnErrorAndClosed) {
    WebSocketOptions options;
    options.maxMessageBytes = 10'000;
    start(options);
    const auto client = join();
    client->send(std::string(10'000, 'x'));
    recorder_.messages(recorder_.session(0), 1);
    client->send(std::string(10'001, 'x'));
    EXPECT_EQ(client->readError().code, "frameTooLarge");
    EXPECT_EQ(client->closeCode(), websocket::close_code::too_big);
    EXPECT_EQ(recorder_.messages(recorder_.session(0), 0).size(), 1u);
}

TEST_F(HttpServerTest, AHandlerThatThrowsEndsItsSessionOnly) {
    start();
    const auto faulty = join(), other = join();
    faulty->send("throw");
    EXPECT_EQ(faulty->readError().code, "internal");
    EXPECT_EQ(faulty->closeCode(), websocket::close_code::internal_error);
    other->send("fine");
    EXPECT_THAT(recorder_.messages(recorder_.session(1), 1), testing::ElementsAre("fine"));
}

TEST_F(HttpServerTest, CloseSendsWhatIsQueuedFirst) {
    start();
    const auto client = join();
    const SessionId session = recorder_.session(0);
    onServer([&](auto& server) {
        server.send(session, shared("last words"));
        server.close(session);
        server.send(session, shared("too late"));
    });
    EXPECT_EQ(client->read(), "last words");
    EXPECT_EQ(client->closeCode(), websocket::close_code::normal);
    EXPECT_TRUE(recorder_.waitClosed(session));
}

// A commit may be larger than the bound for unsent data, and the state of its layer follows at
// once.
TEST_F(HttpServerTest, DataAfterALargeFrameDoesNotCutItsReader) {
    WebSocketOptions options;
    options.slowReaderBytes = 1 << 20;
    start(options);
    const auto client = join();
    const SessionId session = recorder_.session(0);
    const std::string large(8 << 20, 'x');
    onServer([&](auto& server) {
        server.send(session, shared(large));
        for (int i = 0; i < 100; ++i) server.send(session, shared("small"));
    });
    std::string read;
    while (read.size() < large.size() + 500) {
        const std::string more = client->read();
        ASSERT_NE(more, "");
        read += more;
    }
    EXPECT_TRUE(read.ends_with("smallsmall"));
    EXPECT_EQ(recorder_.closedTimes(session), 0u);
}

// Sends until the session is cut: the system's buffers take some megabytes as well.
TEST_F(HttpServerTest, CutsASlowReaderAndNoOther) {
    WebSocketOptions options;
    options.slowReaderBytes = 1 << 20;
    start(options);
    const auto slow = join(4096);
    const auto quick = join();
    const SessionId slowId = recorder_.session(0), quickId = recorder_.session(1);
    const SharedBytes frame = shared(std::string(64 * 1024, 'x'));
    std::size_t sent = 0, read = 0;
    while (!recorder_.closedTimes(slowId) && sent < 64u << 20) {
        onServer([&](auto& server) {
            server.send(slowId, frame);
            server.send(quickId, frame);
        });
        sent += frame->size();
        while (read < sent) read += quick->read().size();
        const auto counters = onServer([](auto& server) { return server.counters(); });
        EXPECT_LE(counters.queuedBytes, options.slowReaderBytes + 2 * frame->size());
    }
    EXPECT_EQ(recorder_.closedTimes(slowId), 1u);
    EXPECT_EQ(recorder_.closedTimes(quickId), 0u);
    EXPECT_EQ(read, sent);
    EXPECT_EQ(onServer([](auto& server) { return server.counters().slowReaders; }), 1u);

    // When the client reads again, it receives the reason.
    std::string last, message;
    while (!(message = slow->read()).empty()) last = message;
    EXPECT_THAT(last, HasSubstr("slowReader"));
    EXPECT_EQ(slow->stream.reason().code, websocket::close_code::policy_error);
}

TEST_F(HttpServerTest, ReportsWhenACongestedSessionHasDrained) {
    start();
    const auto client = join(4096);
    const SessionId session = recorder_.session(0);
    EXPECT_FALSE(onServer([&](auto& server) { return server.congested(session); }));
    const SharedBytes frame = shared(std::string(512 * 1024, 'x'));
    onServer([&](auto& server) {
        for (int i = 0; i < 24; ++i) server.send(session, frame);
    });
    EXPECT_TRUE(onServer([&](auto& server) { return server.congested(session); }));
    for (std::size_t read = 0; read < 24 * frame->size();) read += client->read().size();
    EXPECT_TRUE(recorder_.waitDrained(session));
    EXPECT_FALSE(onServer([&](auto& server) { return server.congested(session); }));
}

TEST_F(HttpServerTest, CutsAReaderWithoutProgress) {
    WebSocketOptions options;
    options.slowReaderTime = 300ms;
    start(options);
    const auto client = join(4096);
    const SessionId session = recorder_.session(0);
    const SharedBytes large = shared(std::string(15 << 20, 'x'));
    onServer([&](auto& server) { server.send(session, large); });
    EXPECT_FALSE(recorder_.waitClosed(session, 200ms));
    // 14 MiB above the usual megabyte get time for a slow connection.
    EXPECT_FALSE(recorder_.waitClosed(session, 500ms));
    client->stream.next_layer().close();

    const auto small = join(4096);
    const SessionId second = recorder_.session(1);
    const SharedBytes frame = shared(std::string(512 * 1024, 'x'));
    onServer([&](auto& server) {
        for (int i = 0; i < 16; ++i) server.send(second, frame);
    });
    EXPECT_TRUE(recorder_.waitClosed(second, 3s));
}

TEST_F(HttpServerTest, NoticesADeadPeer) {
    WebSocketOptions options;
    options.peerTime = 400ms;
    start(options);
    const auto client = join();  // it reads nothing, so it answers no ping
    EXPECT_FALSE(recorder_.waitClosed(recorder_.session(0), 200ms));
    EXPECT_TRUE(recorder_.waitClosed(recorder_.session(0), 2s));
}

TEST_F(HttpServerTest, APeerThatAnswersPingsStays) {
    WebSocketOptions options;
    options.peerTime = 200ms;
    start(options);
    const auto client = join();
    std::thread reader([&] { EXPECT_EQ(client->read(), "still here"); });
    const SessionId session = recorder_.session(0);
    EXPECT_FALSE(recorder_.waitClosed(session, 1s));
    onServer([&](auto& server) { server.send(session, shared("still here")); });
    reader.join();
}

TEST_F(HttpServerTest, SourcesTakeTurnsAndLetSmallFramesPass) {
    start();
    const auto client = join(4096);
    const SessionId session = recorder_.session(0);
    constexpr std::size_t kChunk = 300'000;
    constexpr int kChunks = 40;
    std::atomic<int> made = 0;
    const auto source = [&](char name) {
        return [name, &made, left = kChunks](std::size_t) mutable -> SharedBytes {
            if (left-- == 0) return nullptr;
            ++made;
            return shared(std::string(kChunk, name));
        };
    };
    onServer([&](auto& server) {
        server.sendBeside(session, source('a'));
        server.sendBeside(session, source('b'));
    });
    std::this_thread::sleep_for(200ms);
    EXPECT_LT(made, 2 * kChunks);  // sources are read lazily: the reader has not read yet

    // A small frame is sent before the rest of the sources.
    onServer([&](auto& server) { server.send(session, shared("!")); });
    std::string all;
    while (all.size() < 2 * kChunk * kChunks + 1) all += client->read();
    const std::size_t at = all.find('!');
    EXPECT_LT(at, all.size() - 10 * kChunk);
    all.erase(at, 1);
    for (int chunk = 0; chunk < 2 * kChunks; ++chunk)
        ASSERT_EQ(all.substr(std::size_t(chunk) * kChunk, kChunk),
                  std::string(kChunk, chunk % 2 ? 'b' : 'a'));
}

TEST_F(HttpServerTest, ASourceThatThrowsClosesTheSession) {
    start();
    const auto client = join();
    const SessionId session = recorder_.session(0);
    onServer([&](auto& server) {
        server.sendBeside(session,
                          [](std::size_t) -> SharedBytes { throw std::runtime_error("a bug"); });
    });
    EXPECT_EQ(client->readError().code, "internal");
}

TEST_F(HttpServerTest, ReadsOnlyWhileItShould) {
    start();
    const auto client = join();
    const SessionId session = recorder_.session(0);
    onServer([&](auto& server) { server.setReading(session, false); });
    client->send("one");  // the pending read
    EXPECT_EQ(recorder_.messages(session, 1).size(), 1u);
    client->send("two");
    std::this_thread::sleep_for(50ms);
    EXPECT_EQ(recorder_.messages(session, 1).size(), 1u);
    onServer([&](auto& server) { server.setReading(session, true); });
    EXPECT_EQ(recorder_.messages(session, 2).size(), 2u);
}

TEST_F(HttpServerTest, StopNotifiesEverybodyAndDoesNotWaitForEver) {
    start();
    const auto polite = join(), silent = join();
    std::promise<void> stopped;
    onServer([&](auto& server) {
        server.stop(Error{ErrorCode::ShuttingDown, "bye"}, 500ms, [&] { stopped.set_value(); });
    });
    EXPECT_EQ(polite->readError().code, "shuttingDown");
    EXPECT_EQ(polite->closeCode(), websocket::close_code::going_away);
    EXPECT_EQ(stopped.get_future().wait_for(3s), std::future_status::ready);
    EXPECT_TRUE(recorder_.waitClosed(recorder_.session(0)));
    EXPECT_TRUE(recorder_.waitClosed(recorder_.session(1)));
    EXPECT_THROW(join(), beast::system_error);
}

}  // namespace
