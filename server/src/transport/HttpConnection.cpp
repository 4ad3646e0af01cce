// Reads one HTTP request and answers it, or hands the connection over as a session.
#include "transport/HttpConnection.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <cstring>
#include <optional>
#include <utility>

#include "transport/HttpRanges.h"
#include "transport/ServerTls.h"
#include "transport/Upgrade.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using std::chrono::steady_clock;

// A token of an issuer may have 16 KiB.
constexpr std::size_t kHeaderBytes = 24 * 1024;
// The time limit for sending the answer and for the peer to close afterwards.
constexpr std::chrono::seconds kAnswerTime{5};

// The size of the parts of a content. Two of them are in memory: one is sent while the next one is
// read.
constexpr std::uint64_t kPartBytes = 512 * 1024;

// The first byte of a client's first record of TLS.
constexpr std::uint8_t kTlsHandshake = 0x16;

constexpr unsigned kOk = 200, kPartial = 206, kNotModified = 304, kBadRequest = 400,
                   kForbidden = 403, kNotAllowed = 405, kRangeNotSatisfiable = 416,
                   kMisdirected = 421, kUpgradeRequired = 426, kHeadersTooLarge = 431,
                   kInternal = 500, kUnavailable = 503;

using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

HttpTarget targetOf(const Request& request) {
    const std::string_view target = view(request.target());
    const std::size_t mark = target.find('?');
    HttpTarget parts{.path = target.substr(0, mark),
                     .authorization = view(request[http::field::authorization]),
                     .subprotocols = view(request[http::field::sec_websocket_protocol])};
    if (mark != std::string_view::npos) parts.query = target.substr(mark + 1);
    return parts;
}

std::string inQuotes(const std::string& etag) { return '"' + etag + '"'; }

class Connection final : public HttpConnection, public std::enable_shared_from_this<Connection> {
public:
    Connection(HttpHub& hub, NetStream stream, std::unique_ptr<Seat> seat)
        : hub_(hub),
          stream_(std::move(stream)),
          seat_(std::move(seat)),
          buffer_(2 * kHeaderBytes),
          deadline_(steady_clock::now() + hub.options.headerTime) {
        parser_.header_limit(kHeaderBytes);
    }

    void start() override {
        seat_->giveWayBy([io = &hub_.io, weak = weak_from_this()] {
            asio::post(*io, [weak] {
                if (const auto self = weak.lock()) self->finish();
            });
        });
        if (hub_.options.tls)
            recognize();
        else
            readHeader();
    }

    void sweep(TimePoint now) override {
        if (done_) return;
        if (now < deadline_) {
            if (waits_) seat_->moved(now);  // for this server
            return;
        }
        if (std::exchange(waits_, false))
            return answer({"text/plain", "the server is busy; try again\n", kUnavailable});
        cut();
    }

    void cut() override { stream_.close(); }

    void abandon() override {
        done_ = true;
        cut();
        seat_.reset();
    }

private:
    /// Looks at the first byte, because a request in plain text deserves an answer that it can
    /// read.
    void recognize() {
        stream_.socket().async_wait(NetSocket::wait_read,
                                    [self = shared_from_this()](beast::error_code error) {
                                        if (error || self->done_) return self->finish();
                                        std::uint8_t first = 0;
                                        if (::recv(self->stream_.socket().native_handle(), &first,
                                                   1, MSG_PEEK | MSG_DONTWAIT) != 1)
                                            return self->finish();
                                        if (first == kTlsHandshake) return self->encrypt();
                                        self->isPlainByMistake_ = true;
                                        self->readHeader();
                                    });
    }

    void encrypt() {
        stream_.encrypt(hub_.options.tls->accepted());
        stream_.async_handshake([self = shared_from_this()](beast::error_code error) {
            if (self->done_) return;
            if (!error) return self->readHeader();
            self->hub_.log.write(LogLevel::Debug, "handshake of TLS failed",
                                 {{"error", error.message()}});
            self->finish();
        });
    }

    void readHeader() {
        http::async_read_header(stream_, buffer_, parser_,
                                [self = shared_from_this()](beast::error_code error, std::size_t) {
                                    self->onHeader(error);
                                });
    }

    void onHeader(beast::error_code error) {
        if (done_) return;
        if (error == http::error::header_limit || error == http::error::buffer_overflow)
            return answer({"text/plain", "headers too large\n", kHeadersTooLarge});
        if (error.category() == http::make_error_code(http::error::bad_method).category() &&
            error != http::error::end_of_stream && error != http::error::partial_message)
            return answer({"text/plain", "not HTTP: " + error.message() + "\n", kBadRequest});
        if (error) return finish();
        if (isPlainByMistake_)
            return answer(
                {"text/plain", "this server speaks TLS: use wss:// or https://\n", kBadRequest});
        route(parser_.get());
    }

    void route(const Request& request) {
        HttpTarget target = targetOf(request);
        beast::error_code ignored;
        const std::string peer = stream_.socket().remote_endpoint(ignored).address().to_string();
        target.peer = peer;
        isHead_ = request.method() == http::verb::head;
        if (auto refusal = refusedHost(request)) return answer(std::move(*refusal));
        if (auto refusal = refusedOrigin(request)) return answer(std::move(*refusal));
        try {
            const HttpRoute route = hub_.router(target);
            if (const auto* refusal = std::get_if<HttpReply>(&route)) return answer(*refusal);
            if (const auto* again = std::get_if<HttpAgain>(&route)) return routeAgain(*again);
            const bool isPost = request.method() == http::verb::post;
            if (const auto* action = std::get_if<HttpAction>(&route))
                return isPost
                           ? get(action->run)
                           : answer(
                                 {"text/plain", "only POST\n", kNotAllowed, {{"Allow", "POST"}}});
            if (request.method() != http::verb::get && !isHead_)
                return answer(
                    {"text/plain", "only GET and HEAD\n", kNotAllowed, {{"Allow", "GET, HEAD"}}});
            if (const auto* page = std::get_if<HttpPage>(&route)) return get(*page);
            session(request, std::get<HttpSessions>(route));
        } catch (const std::exception& fault) {
            hub_.log.write(LogLevel::Error, "http route failed",
                           {{"path", target.path}, {"error", fault.what()}});
            answer({"text/plain", "internal error of the server\n", kInternal});
        }
    }

    void routeAgain(const HttpAgain& again) {
        if (std::exchange(hasWaited_, true))
            return answer({"text/plain", "the server is busy; try again\n", kUnavailable});
        waits_ = true;
        deadline_ = steady_clock::now() + hub_.options.answerTime;
        again.wait([io = &hub_.io, weak = weak_from_this()] {
            asio::post(*io, [weak] {
                const auto self = weak.lock();
                if (self && !self->done_ && std::exchange(self->waits_, false))
                    self->route(self->parser_.get());
            });
        });
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

    void session(const Request& request, const HttpSessions& sessions) {
        // A client has to wait for the answer, so further bytes are not WebSocket.
        if (!beast::websocket::is_upgrade(request) || buffer_.size() != 0)
            return answer({"text/plain", "this is a WebSocket endpoint\n", kUpgradeRequired});
        done_ = true;
        seat_->giveWayBy(nullptr);
        seat_->moved(steady_clock::now());
        sessions.transport->take(std::make_unique<Upgrade>(
            Upgrade{parser_.release(), stream_.release(), std::move(seat_), sessions.user,
                    sessions.showsToken}));
        hub_.finished(*this);
    }

    /// HO1. A request without the header is not one of a browser.
    std::optional<HttpReply> refusedHost(const Request& request) const {
        const auto header = request.find(http::field::host);
        if (header == request.end() || header->value().empty()) return std::nullopt;
        const auto host = hostOf(view(header->value()));
        if (host && hub_.options.hosts.allows(*host)) return std::nullopt;
        hub_.log.write(LogLevel::Warning, "host refused", {{"host", view(header->value())}});
        if (!host) return HttpReply{"text/plain", "the header Host names no host\n", kBadRequest};
        return HttpReply{"text/plain",
                         "this server does not know itself as " + *host +
                             ". Use its address, or start it with --allow-host " + *host + "\n",
                         kMisdirected};
    }

    /// HO2. Other programs than browsers send no origin.
    std::optional<HttpReply> refusedOrigin(const Request& request) const {
        const auto origin = request.find(http::field::origin);
        const bool isForeign = origin == request.end() ? isOfOtherSite(request)
                                                       : !isAllowed(view(origin->value())) &&
                                                             !isOwn(view(origin->value()), request);
        if (!isForeign) return std::nullopt;
        hub_.log.write(LogLevel::Warning, "origin refused",
                       {{"origin", view(request[http::field::origin])}});
        return HttpReply{"text/plain",
                         "pages of this origin may not connect. Start the server with "
                         "--allow-origin to allow it\n",
                         kForbidden};
    }

    bool isAllowed(std::string_view origin) const {
        return std::ranges::any_of(hub_.options.allowedOrigins, [&](const std::string& allowed) {
            return allowed == "*" || allowed == origin;
        });
    }

    /// Returns whether the origin is that of the server's own pages. Its host was checked (HO1).
    bool isOwn(std::string_view origin, const Request& request) const {
        const std::string scheme = hub_.options.tls ? "https://" : "http://";
        return origin == scheme + std::string(view(request[http::field::host]));
    }

    /// A picture or script of another site's page has no origin, but browsers say what it is for.
    bool isOfOtherSite(const Request& request) const {
        const auto site = view(request["Sec-Fetch-Site"]);
        if (site != "cross-site" && site != "same-site") return false;
        return view(request["Sec-Fetch-Mode"]) != "navigate" && !isAllowed("*");
    }

    void answer(HttpReply reply) {
        const bool isCompressible = bool(reply.compressed);
        if (isCompressible) reply.headers.emplace_back("Vary", "Accept-Encoding");
        const bool isKnown = matches(reply.etag) || (isCompressible && matches(zstdEtag(reply)));
        if (!reply.etag.empty() && reply.status == kOk && isKnown) {
            reply.status = kNotModified;
            reply.content.reset();
            reply.body.clear();
        } else if (isCompressible && reply.status == kOk && !isHead_ && takesZstd()) {
            return compress(std::move(reply));
        }
        send(std::move(reply));
    }

    static std::string zstdEtag(const HttpReply& reply) { return reply.etag + kZstdEtag; }

    bool takesZstd() {
        const Request& request = parser_.get();
        if (!request[http::field::range].empty()) return false;
        for (const auto& [coding, parameters] :
             http::ext_list(request[http::field::accept_encoding]))
            if (beast::iequals(coding, "zstd"))
                return std::ranges::none_of(parameters, [](const auto& one) {
                    return beast::iequals(one.first, "q") && one.second.starts_with('0') &&
                           one.second.find_first_not_of("0.") == beast::string_view::npos;
                });
        return false;
    }

    void compress(HttpReply reply) {
        waits_ = true;
        deadline_ = steady_clock::now() + hub_.options.answerTime;
        const auto background = reply.background;
        background([io = &hub_.io, weak = weak_from_this(), reply = std::move(reply)]() mutable {
            auto content = reply.compressed();
            asio::post(*io,
                       [weak, reply = std::move(reply), content = std::move(content)]() mutable {
                           const auto self = weak.lock();
                           if (!self || self->done_ || !std::exchange(self->waits_, false)) return;
                           if (content) {
                               reply.etag = zstdEtag(reply);
                               reply.headers.emplace_back("Content-Encoding", "zstd");
                               reply.content = std::move(content);
                           }
                           self->send(std::move(reply));
                       });
        });
    }

    void send(HttpReply reply) {
        const std::uint64_t size = reply.content ? reply.content->size() : reply.body.size();
        ByteRange range{0, size};
        if (reply.content && reply.status == kOk) range = rangeOf(reply, size);
        const std::uint64_t count = range.end - range.begin;
        setHead(reply);
        if (reply.status != kNotModified) response_.content_length(count);
        if (isHead_ || !reply.content) {
            if (!isHead_) response_.body() = std::move(reply.body);
            reply.content.reset();
        }
        content_ = std::move(reply.content);
        background_ = std::move(reply.background);
        unread_ = range.begin;
        unsent_ = content_ ? count : 0;
        end_ = range.end;
        extend(kAnswerTime);
        if (!content_) return sendWhole();
        serializer_.emplace(response_);
        http::async_write_header(stream_, *serializer_,
                                 [self = shared_from_this()](beast::error_code error, std::size_t) {
                                     if (error || self->done_) return self->finish();
                                     self->readPart();
                                     if (self->unsent_ == 0) self->sent();
                                 });
    }

    void setHead(const HttpReply& reply) {
        const auto status = http::status(reply.status);
        response_.result(status);
        response_.set(http::field::server, "usdlive");
        if (!reply.contentType.empty()) response_.set(http::field::content_type, reply.contentType);
        for (const auto& [name, value] : reply.headers) response_.set(name, value);
        if (!reply.etag.empty()) response_.set(http::field::etag, inQuotes(reply.etag));
        // A client may keep what has an ETag, and asks each time whether it is still valid.
        response_.set(http::field::cache_control, reply.etag.empty() ? "no-store" : "no-cache");
        if (status == http::status::upgrade_required) {
            response_.set(http::field::upgrade, "websocket");
            response_.set(http::field::connection, "upgrade, close");
        }
        response_.keep_alive(false);
    }

    bool matches(const std::string& etag) {
        const std::string_view wanted = view(parser_.get()[http::field::if_none_match]);
        return wanted == "*" || wanted.find(inQuotes(etag)) != std::string_view::npos;
    }

    /// Returns the bytes that the request asks for, and sets the status of the reply.
    ByteRange rangeOf(HttpReply& reply, std::uint64_t size) {
        const Request& request = parser_.get();
        reply.headers.emplace_back("Accept-Ranges", "bytes");
        const std::string_view condition = view(request[http::field::if_range]);
        const std::string_view header = view(request[http::field::range]);
        if (header.empty() || (!condition.empty() && condition != inQuotes(reply.etag)))
            return {0, size};
        const auto range = parseByteRange(header, size);
        if (!range) return {0, size};
        const bool isEmpty = range->begin == range->end;
        reply.status = isEmpty ? kRangeNotSatisfiable : kPartial;
        const std::string bytes =
            isEmpty ? "*" : std::to_string(range->begin) + "-" + std::to_string(range->end - 1);
        reply.headers.emplace_back("Content-Range", "bytes " + bytes + "/" + std::to_string(size));
        return *range;
    }

    void sendWhole() {
        serializer_.emplace(response_);
        const auto done = [self = shared_from_this()](beast::error_code error, std::size_t) {
            if (error || self->done_) return self->finish();
            self->sent();
        };
        if (isHead_)
            http::async_write_header(stream_, *serializer_, done);
        else
            http::async_write(stream_, *serializer_, done);
    }

    // ---- a content in parts: one is read while the one before it is sent

    void readPart() {
        if (isReading_ || ready_ || unread_ == end_) return;
        isReading_ = true;
        const std::uint64_t offset = unread_, size = std::min(kPartBytes, end_ - unread_);
        unread_ += size;
        Bytes part = std::move(spare_);
        part.resize(size);
        background_([io = &hub_.io, weak = weak_from_this(), content = content_, offset,
                     part = std::move(part)]() mutable {
            auto read = content->read(offset, part);
            asio::post(*io, [weak, read = std::move(read), part = std::move(part)]() mutable {
                if (const auto self = weak.lock()) self->partRead(read, std::move(part));
            });
        });
    }

    void partRead(const Result<void>& read, Bytes part) {
        if (done_) return;
        isReading_ = false;
        if (!read) {
            hub_.log.write(LogLevel::Warning, "download ended", {{"error", read.error().message}});
            return finish();
        }
        ready_ = std::move(part);
        writePart();
    }

    void writePart() {
        if (isWriting_ || !ready_) return;
        isWriting_ = true;
        spare_ = std::exchange(writing_, std::move(*ready_));
        ready_.reset();
        extend(hub_.options.answerTime);
        // Asio would send 64 KiB at a time.
        const auto wholePart = [](const beast::error_code& error, std::size_t /*sent*/) {
            return error ? 0 : std::size_t(kPartBytes);
        };
        asio::async_write(stream_, asio::buffer(writing_), wholePart,
                          [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (error || self->done_) return self->finish();
                              self->partWritten();
                          });
        readPart();
    }

    void partWritten() {
        isWriting_ = false;
        unsent_ -= writing_.size();
        extend(hub_.options.answerTime);
        if (unsent_ == 0) return sent();
        writePart();
    }

    void extend(std::chrono::milliseconds time) {
        const TimePoint now = steady_clock::now();
        deadline_ = now + time;
        seat_->moved(now);
    }

    void sent() {
        stream_.shutdownSend();
        extend(kAnswerTime);
        drain();
    }

    // Reads the rest, because closing with unread bytes would reset the connection and could lose
    // the answer.
    void drain() {
        stream_.async_read_some(asio::buffer(scratch_),
                                [self = shared_from_this()](beast::error_code error, std::size_t) {
                                    if (error) return self->finish();
                                    self->drain();
                                });
    }

    void finish() {
        if (std::exchange(done_, true)) return;
        cut();
        seat_.reset();
        hub_.finished(*this);
    }

    HttpHub& hub_;
    NetStream stream_;
    std::unique_ptr<Seat> seat_;  // nullptr after the end
    beast::flat_buffer buffer_;
    http::request_parser<http::empty_body> parser_;
    Response response_;
    std::optional<http::response_serializer<http::string_body>> serializer_;
    std::array<char, 512> scratch_;
    TimePoint deadline_;
    bool isHead_ = false;
    bool isPlainByMistake_ = false;  // a request in plain text, and the server demands TLS

    // A content that is being sent.
    std::shared_ptr<HttpContent> content_;
    std::function<void(std::function<void()>)> background_;
    std::uint64_t unread_ = 0, end_ = 0;  // the bytes that were not read yet
    std::uint64_t unsent_ = 0;            // number of bytes
    std::optional<Bytes> ready_;          // a part that was read
    Bytes writing_;
    Bytes spare_;  // memory for a part that is read later
    bool isReading_ = false, isWriting_ = false;

    bool waits_ = false;      // for the page's answer, or for what the router needs
    bool hasWaited_ = false;  // for the router
    bool done_ = false;
};

}  // namespace

std::shared_ptr<HttpConnection> createHttpConnection(HttpHub& hub, NetStream stream,
                                                     std::unique_ptr<Seat> seat) {
    return std::make_shared<Connection>(hub, std::move(stream), std::move(seat));
}

}  // namespace usdlive::server
