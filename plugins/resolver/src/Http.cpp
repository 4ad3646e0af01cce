// Sends requests over HTTP with Boost.Beast.
#include "Http.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/buffer_body.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <cerrno>
#include <string_view>

#include "Inflated.h"
#include "usdlive/common/core/PercentEncoding.h"

namespace usdlive::resolver {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr unsigned kOk = 200, kNotModified = 304;
constexpr std::size_t kHeaderBytes = 64 * 1024;
// The memory of a body that is kept grows by this.
constexpr std::size_t kGrowthBytes = 64 * 1024;
// The time until a request notices that it is stopped.
constexpr std::chrono::milliseconds kNotice{50};

// The least part of a body that counts as one.
constexpr std::uint64_t kPartBytes = 4 * 1024;
// The first line of an answer without success says why.
constexpr std::uint64_t kMostReasonBytes = 64 * 1024;

thread_local std::function<bool()> stopsHere;

std::string text(beast::string_view view) { return {view.data(), view.size()}; }

/// Keeps a body that no sink takes.
class BodyInMemory final : public BodySink {
public:
    explicit BodyInMemory(std::string& body) : body_(body) {}
    std::span<char> space() override {
        body_.resize(filled_ + kGrowthBytes);
        return std::span(body_).subspan(filled_);
    }
    std::string add(std::size_t size) override {
        body_.resize(filled_ += size);
        return {};
    }

private:
    std::string& body_;
    std::size_t filled_ = 0;
};

/// One request on one connection. Asio's operations run on this thread, one at a time.
class Exchange {
public:
    Exchange(const HttpRequest& request, const HttpTimes& times)
        : request_(request), times_(times), stream_(io_), parser_(), buffer_(kHeaderBytes) {
        parser_.body_limit(boost::none);
    }

    Outcome<HttpAnswer> run() {
        if (const error_code error = connect()) return Failure{causeOf(error)};
        if (const error_code error = send()) return Failure{"cannot send: " + causeOf(error)};
        stream_.expires_after(times_.answer);
        const error_code error = wait([&](auto done) {
            http::async_read_header(stream_, buffer_, parser_, std::move(done));
        });
        if (error) return Failure{"no answer: " + causeOf(error)};
        const auto& head = parser_.get();
        HttpAnswer answer{head.result_int(),
                          unquoted(text(head[http::field::etag])),
                          text(head["Usdlive-Sha256"]),
                          {}};
        if (std::string problem = read(answer); !problem.empty()) return Failure{problem};
        return answer;
    }

private:
    /// Starts an operation and returns its result.
    template <class Start>
    error_code wait(Start start) {
        error_code result = asio::error::timed_out;
        start([&result](error_code error, const auto&...) { result = error; });
        for (io_.restart(); !io_.stopped(); io_.run_for(kNotice))
            if (areRequestsStopped()) stream_.cancel();
        return result;
    }

    std::string causeOf(const error_code& error) const {
        if (error == beast::error::timeout || error == asio::error::timed_out)
            return "it did not respond in time";
        if (error == asio::error::connection_refused)
            return "connection refused. Is \"usdlive serve\" running there?";
        if (error == http::error::end_of_stream || error == http::error::partial_message)
            return "the connection ended before the end";
        return error.message();
    }

    error_code connect() {
        std::vector<tcp::endpoint> endpoints;
        error_code error;
        if (request_.host == "localhost") {  // without a name server
            endpoints = {{asio::ip::address_v4::loopback(), request_.port},
                         {asio::ip::address_v6::loopback(), request_.port}};
        } else {
            tcp::resolver resolver(io_);
            const auto found =
                resolver.resolve(request_.host, std::to_string(request_.port), error);
            if (error) return error;
            for (const auto& one : found) endpoints.push_back(one.endpoint());
        }
        error_code first;
        for (const tcp::endpoint& endpoint : endpoints) {
            stream_.close();  // the one before may be of the other family
            stream_.expires_after(times_.connect);
            error = wait([&](auto done) { stream_.async_connect(endpoint, std::move(done)); });
            if (!error) {
                stream_.socket().set_option(tcp::no_delay(true), error);
                return {};
            }
            if (!first) first = error;
        }
        return first;
    }

    error_code send() {
        http::request<http::empty_body> message{http::verb::get, request_.target, 11};
        const bool isIpv6 = request_.host.find(':') != std::string::npos;
        message.set(http::field::host, (isIpv6 ? "[" + request_.host + "]" : request_.host) + ":" +
                                           std::to_string(request_.port));
        message.set(http::field::user_agent, "usdliveResolver");
        if (request_.takesZstd) message.set(http::field::accept_encoding, "zstd");
        for (const auto& [name, value] : request_.headers) message.set(name, value);
        stream_.expires_after(times_.answer);
        return wait([&](auto done) { http::async_write(stream_, message, std::move(done)); });
    }

    /// Reads the body. Returns the reason why it is not complete. A large body is read from the
    /// socket directly: Asio's timers and small reads would take most of the time.
    std::string read(HttpAnswer& answer) {
        if (answer.status == kNotModified) return {};
        const auto length = parser_.content_length();
        if (!length) return "the answer has no length. Is this a usdlive server?";
        const std::uint64_t left = *length;
        BodyInMemory body(answer.body);
        const bool goesToSink = request_.sink && answer.status == kOk;
        if (answer.status != kOk && left > kMostReasonBytes) return {};
        if (!goesToSink && left > request_.mostBytes) return "the answer is too large";
        BodySink& target = goesToSink ? *request_.sink : body;
        const auto encoding = parser_.get()[http::field::content_encoding];
        if (encoding.empty()) return read(target, left);
        if (encoding != "zstd") return "the answer has the unknown encoding " + text(encoding);
        Inflated inflated(target);
        std::string problem = read(inflated, left);
        return problem.empty() ? inflated.finish() : problem;
    }

    std::string read(BodySink& sink, std::uint64_t left) {
        using Clock = std::chrono::steady_clock;
        auto partEnd = Clock::now() + times_.stall;
        std::uint64_t atPart = left;  // how much was left when the part began
        while (left > 0) {
            if (atPart - left >= kPartBytes) {
                partEnd = Clock::now() + times_.stall;
                atPart = left;
            } else if (Clock::now() > partEnd) {
                return "it sends too slowly";
            }
            std::span<char> space = sink.space();
            space = space.first(std::min<std::uint64_t>(space.size(), left));
            const ssize_t count = buffer_.size() > 0 ? takeEarly(space) : receive(space);
            if (count == 0) return causeOf(http::error::partial_message);
            if (count < 0) return causeOf({errno, boost::system::system_category()});
            if (std::string problem = sink.add(std::size_t(count)); !problem.empty())
                return problem;
            left -= std::uint64_t(count);
        }
        return {};
    }

    /// Takes what arrived with the headers.
    ssize_t takeEarly(std::span<char> space) {
        const std::size_t count =
            asio::buffer_copy(asio::buffer(space.data(), space.size()), buffer_.data());
        buffer_.consume(count);
        return ssize_t(count);
    }

    /// Reads what has arrived, and waits for it if necessary. Returns 0 at the end, -1 on an error.
    ssize_t receive(std::span<char> space) {
        const int socket = stream_.socket().native_handle();
        errno = ETIMEDOUT;
        for (auto left = times_.stall; left.count() > 0;) {
            if (areRequestsStopped()) {
                errno = ECANCELED;
                return -1;
            }
            const ssize_t count = ::recv(socket, space.data(), space.size(), MSG_DONTWAIT);
            if (count >= 0 || (errno != EAGAIN && errno != EINTR)) return count;
            pollfd ready{socket, POLLIN, 0};
            const auto wait = std::min(left, kNotice);
            const int found = ::poll(&ready, 1, int(wait.count()));
            if (found < 0 && errno != EINTR) return -1;
            if (found == 0) left -= wait;
            errno = ETIMEDOUT;
        }
        return -1;
    }

    static std::string unquoted(std::string etag) {
        if (etag.size() >= 2 && etag.front() == '"') etag = etag.substr(1, etag.size() - 2);
        return etag;
    }

    const HttpRequest& request_;
    const HttpTimes& times_;
    asio::io_context io_{1};
    beast::tcp_stream stream_;
    http::response_parser<http::buffer_body> parser_;
    beast::flat_buffer buffer_;
};

}  // namespace

StoppableRequests::StoppableRequests(std::function<bool()> isStopped) {
    stopsHere = std::move(isStopped);
}
StoppableRequests::~StoppableRequests() { stopsHere = nullptr; }

bool areRequestsStopped() { return stopsHere && stopsHere(); }

bool isLoopback(const std::string& host) {
    if (host == "localhost") return true;
    error_code error;
    const auto address = asio::ip::make_address(host, error);
    return !error && address.is_loopback();
}

Outcome<HttpAnswer> httpGet(const HttpRequest& request, const HttpTimes& times) {
    try {
        return Exchange(request, times).run();
    } catch (const std::exception& fault) {
        return Failure{fault.what()};
    }
}

std::string urlEncoded(const std::string& text) {
    return percentEncodedIf(text, [](char c) {
        const bool isLetter =
            (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        return !isLetter && std::string_view("-._~/").find(c) == std::string_view::npos;
    });
}

}  // namespace usdlive::resolver
