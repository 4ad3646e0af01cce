// Gets answers over HTTP or HTTPS with several connections on one thread.
#include "Fetcher.h"

#include <algorithm>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <charconv>
#include <ctime>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <variant>

namespace usdlive::edf::museum {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace ssl = boost::asio::ssl;
using boost::system::error_code;

constexpr auto kTuple = asio::as_tuple(asio::use_awaitable);
constexpr auto kCancelInterval = std::chrono::milliseconds(50);
constexpr std::uint32_t kMaxHeaderBytes = 16 * 1024;
// A service may say "never ask again"; we ask again after a day.
constexpr std::int64_t kMaxFreshSeconds = 24 * 3600;

std::int64_t now() { return std::time(nullptr); }

// Seconds for which the answer needs no revalidation; 0 if the service does not say so.
std::int64_t freshSeconds(std::string_view cacheControl) {
    constexpr std::string_view kMaxAge = "max-age=";
    if (cacheControl.find("no-cache") != std::string_view::npos) return 0;
    const auto at = cacheControl.find(kMaxAge);
    if (at == std::string_view::npos) return 0;
    std::int64_t seconds = 0;
    const char* begin = cacheControl.data() + at + kMaxAge.size();
    std::from_chars(begin, cacheControl.data() + cacheControl.size(), seconds);
    return std::clamp<std::int64_t>(seconds, 0, kMaxFreshSeconds);
}

struct Response {
    http::response<http::string_body> message;
    bool isKept = false;  // the connection stays open
};

// Why a request has no answer. A connection that was kept may have been closed meanwhile, which is
// no fault.
struct Failure {
    std::string text;
    bool isUnreachable = false;
    bool wasClosed = false;
};

// All requests of one Fetcher::get(), on one thread.
class Download {
public:
    Download(const Address& address, const FetchLimits& limits, DiskCache* cache,
             const std::vector<std::string>& targets, const std::function<bool()>& isCancelled)
        : address_(address),
          limits_(limits),
          cache_(cache),
          targets_(targets),
          isCancelled_(isCancelled) {
        result_.answers.assign(targets.size(), tl::unexpected(std::string("not requested")));
        if (!address.isSecure) return;
        error_code ignored;  // without authorities, no certificate is trusted
        tls_.set_default_verify_paths(ignored);
        tls_.set_verify_mode(ssl::verify_peer);
    }

    Fetcher::Result run() {
        const auto lines = std::min<std::size_t>(std::max(limits_.parallel, 1), targets_.size());
        for (std::size_t i = 0; i < lines; ++i) {
            ++running_;
            asio::co_spawn(context_, work(), asio::detached);
        }
        if (lines > 0) asio::co_spawn(context_, watch(), asio::detached);
        context_.run();
        return std::move(result_);
    }

private:
    using Plain = beast::tcp_stream;
    using Secure = ssl::stream<beast::tcp_stream>;
    using Stream = std::optional<std::variant<Plain, Secure>>;

    // Takes the next targets one after the other, over one connection.
    asio::awaitable<void> work() {
        Stream stream;
        while (next_ < targets_.size()) {
            const std::size_t index = next_++;
            if (bytes_ > limits_.totalBytes) {
                result_.answers[index] =
                    tl::unexpected(std::string("not requested, because the others are too large"));
                continue;
            }
            result_.answers[index] = co_await answer(stream, targets_[index]);
            if (result_.answers[index]) bytes_ += result_.answers[index]->size();
        }
        if (--running_ == 0) pause_.cancel();
    }

    // Ends everything when nobody waits for it any more.
    asio::awaitable<void> watch() {
        while (running_ > 0) {
            if (isCancelled_()) {
                context_.stop();
                co_return;
            }
            pause_.expires_after(kCancelInterval);
            co_await pause_.async_wait(kTuple);
        }
    }

    asio::awaitable<Fetched> answer(Stream& stream, const std::string& target) {
        const std::string url = address_.text() + target;
        const auto cached = cache_ ? cache_->find(url) : std::nullopt;
        if (cached && cached->freshUntil > now()) co_return cached->body;
        if (failures_ >= limits_.failures) {
            if (cached) co_return stale(*cached);
            co_return tl::unexpected(url + ": not requested, because " + lastFailure_);
        }
        auto response = co_await request(stream, target, cached);
        // The service may have closed a kept connection. Then the request goes over a new one.
        if (!response && response.error().wasClosed)
            response = co_await request(stream, target, cached);
        if (!response) {
            failures_ = response.error().isUnreachable ? failures_ + 1 : 0;
            lastFailure_ = response.error().text;
            if (cached && response.error().isUnreachable) co_return stale(*cached);
            co_return tl::unexpected(url + ": " + response.error().text);
        }
        failures_ = 0;
        co_return keep(url, cached, *response);
    }

    std::string stale(const CachedAnswer& cached) {
        ++result_.stale;
        return cached.body;
    }

    // Stores a new answer, or confirms that of the cache.
    Fetched keep(const std::string& url, const std::optional<CachedAnswer>& cached,
                 Response& response) {
        auto& message = response.message;
        const std::string_view control = message[http::field::cache_control];
        CachedAnswer answer;
        if (message.result() == http::status::not_modified && cached)
            answer = *cached;
        else if (message.result() != http::status::ok)
            return tl::unexpected(url + ": HTTP " + std::to_string(message.result_int()));
        else
            answer = {message[http::field::etag], message[http::field::last_modified], 0,
                      std::move(message.body())};
        answer.freshUntil = now() + freshSeconds(control);
        if (cache_ && control.find("no-store") != std::string_view::npos)
            cache_->remove(url);
        else if (cache_)
            cache_->store(url, answer);
        return std::move(answer.body);
    }

    asio::awaitable<std::optional<Failure>> connect(Stream& stream) {
        asio::ip::tcp::resolver resolver(context_);
        const auto [lookupError, endpoints] =
            co_await resolver.async_resolve(address_.bareHost(), address_.port, kTuple);
        if (lookupError)
            co_return Failure{"no address was found for the host: " + lookupError.message(), true,
                              false};
        if (address_.isSecure)
            stream.emplace(std::in_place_type<Secure>, context_, tls_);
        else
            stream.emplace(std::in_place_type<Plain>, context_);
        beast::tcp_stream& tcp = tcpOf(*stream);
        tcp.expires_after(limits_.connect);
        const auto [error, endpoint] = co_await tcp.async_connect(endpoints, kTuple);
        std::string why = error ? "cannot connect: " + error.message() : "";
        if (auto* const secure = std::get_if<Secure>(&*stream); secure && !error)
            why = co_await handshake(*secure);
        if (why.empty()) co_return std::nullopt;
        stream.reset();
        co_return Failure{std::move(why), true, false};
    }

    static beast::tcp_stream& tcpOf(std::variant<Plain, Secure>& stream) {
        if (auto* const secure = std::get_if<Secure>(&stream)) return secure->next_layer();
        return std::get<Plain>(stream);
    }

    /// Returns why there is no secure connection; an empty text if there is one.
    asio::awaitable<std::string> handshake(Secure& stream) const {
        const std::string host = address_.bareHost();
        error_code isName;
        asio::ip::make_address(host, isName);
        SSL* const session = stream.native_handle();
        if (isName) {
            SSL_set1_host(session, host.c_str());
            SSL_set_tlsext_host_name(session, host.c_str());  // RFC 6066: not for addresses
        } else {
            X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(session), host.c_str());
        }
        const auto [error] = co_await stream.async_handshake(ssl::stream_base::client, kTuple);
        if (!error) co_return "";
        const long verified = SSL_get_verify_result(session);
        if (verified == X509_V_OK) co_return "no secure connection: " + error.message();
        co_return std::string("the certificate of the service is not trusted: ") +
            X509_verify_cert_error_string(verified) +
            ". SSL_CERT_FILE can name a file with certificates to trust";
    }

    http::request<http::empty_body> requestFor(const std::string& target,
                                               const std::optional<CachedAnswer>& cached) const {
        http::request<http::empty_body> request(http::verb::get, address_.path + target, 11);
        request.set(http::field::host, address_.hostAndPort());
        request.set(http::field::user_agent, "usdlive-edf");
        request.set(http::field::accept, "application/json");
        if (cached && !cached->etag.empty()) request.set(http::field::if_none_match, cached->etag);
        if (cached && !cached->lastModified.empty())
            request.set(http::field::if_modified_since, cached->lastModified);
        return request;
    }

    asio::awaitable<tl::expected<Response, Failure>> request(
        Stream& stream, const std::string& target, const std::optional<CachedAnswer>& cached) {
        const bool wasKept = stream.has_value();
        if (!wasKept)
            if (auto failure = co_await connect(stream))
                co_return tl::unexpected(std::move(*failure));
        tcpOf(*stream).expires_after(limits_.request);
        http::response_parser<http::string_body> parser;
        parser.header_limit(kMaxHeaderBytes);
        parser.body_limit(limits_.bodyBytes);
        const auto message = requestFor(target, cached);
        auto* const secure = std::get_if<Secure>(&*stream);
        const auto error = secure ? co_await exchange(*secure, message, parser)
                                  : co_await exchange(std::get<Plain>(*stream), message, parser);
        if (error) co_return failed(stream, error, wasKept, parser.got_some());
        Response response{parser.release(), parser.keep_alive()};
        if (!response.isKept) stream.reset();
        co_return response;
    }

    template <class Open>
    static asio::awaitable<error_code> exchange(Open& stream,
                                                const http::request<http::empty_body>& message,
                                                http::response_parser<http::string_body>& parser) {
        const auto [writeError, written] = co_await http::async_write(stream, message, kTuple);
        if (writeError) co_return writeError;
        beast::flat_buffer buffer;
        const auto [readError, size] = co_await http::async_read(stream, buffer, parser, kTuple);
        co_return readError;
    }

    tl::unexpected<Failure> failed(Stream& stream, const error_code& error, bool wasKept,
                                   bool hasBegun) const {
        stream.reset();
        if (error == http::error::body_limit)
            return tl::unexpected(
                Failure{"the answer is larger than " + std::to_string(limits_.bodyBytes) + " bytes",
                        false, false});
        const bool wasClosed = wasKept && !hasBegun && error != beast::error::timeout;
        if (error == beast::error::timeout)
            return tl::unexpected(Failure{
                "no complete answer within " + std::to_string(limits_.request.count()) + " ms",
                true, false});
        return tl::unexpected(
            Failure{"the answer could not be read: " + error.message(), !hasBegun, wasClosed});
    }

    const Address& address_;
    const FetchLimits& limits_;
    DiskCache* const cache_;
    const std::vector<std::string>& targets_;
    const std::function<bool()>& isCancelled_;
    ssl::context tls_{ssl::context::tls_client};
    asio::io_context context_{1};
    asio::steady_timer pause_{context_};
    Fetcher::Result result_;
    std::size_t next_ = 0, bytes_ = 0;
    int running_ = 0, failures_ = 0;
    std::string lastFailure_;
};

}  // namespace

Fetcher::Fetcher(Address address, FetchLimits limits, DiskCache* cache)
    : address_(std::move(address)), limits_(limits), cache_(cache) {}

Fetcher::Result Fetcher::get(const std::vector<std::string>& targets,
                             const std::function<bool()>& isCancelled) const {
    return Download(address_, limits_, cache_, targets, isCancelled).run();
}

}  // namespace usdlive::edf::museum
