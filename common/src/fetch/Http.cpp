// Sends requests, and reads the answers with the parser of Boost.Beast.
#include "usdlive/common/fetch/Http.h"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/error.hpp>
#include <boost/beast/http/buffer_body.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/parser.hpp>
#include <cerrno>

#include "Line.h"
#include "usdlive/common/core/PercentEncoding.h"
#include "usdlive/common/fetch/Inflated.h"

namespace usdlive::fetch {

namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using boost::system::error_code;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr unsigned kOk = 200, kNoContent = 204, kPartial = 206, kNotModified = 304;
constexpr std::uint32_t kMostHeaderBytes = 16 * 1024;
// The part that is read at once before the length of the body is known.
constexpr std::size_t kReadBytes = 16 * 1024;
// The memory of a body that is kept grows by this.
constexpr std::size_t kGrowthBytes = 64 * 1024;
// The least part of a body that counts as one.
constexpr std::uint64_t kPartBytes = 4 * 1024;
// The first line of an answer without success says why.
constexpr std::uint64_t kMostReasonBytes = 64 * 1024;

std::string text(boost::beast::string_view view) { return {view.data(), view.size()}; }

std::string tooLarge(std::uint64_t most) {
    return "the answer is too large: it has more than " + std::to_string(most) + " bytes";
}

/// Keeps a body that no sink takes.
class BodyInMemory final : public BodySink {
public:
    BodyInMemory(std::string& body, std::uint64_t most) : body_(body), most_(most) {}
    std::span<char> space() override {
        body_.resize(filled_ + kGrowthBytes);
        return std::span(body_).subspan(filled_);
    }
    std::string add(std::size_t size) override {
        body_.resize(filled_ += size);
        if (filled_ <= most_) return {};
        isTooLarge_ = true;
        return tooLarge(most_);
    }
    [[nodiscard]] bool isTooLarge() const { return isTooLarge_; }

private:
    std::string& body_;
    const std::uint64_t most_;
    std::size_t filled_ = 0;
    bool isTooLarge_ = false;
};

bool isOneLine(std::string_view text) {
    return text.find_first_of(std::string_view("\r\n\0", 3)) == std::string_view::npos;
}

/// Returns the head of the request; an empty text if a line of it would be two.
std::string headOf(const HttpRequest& request) {
    HttpHeaders headers{{"Host", request.origin.hostAndPort()}, {"User-Agent", "usdlive"}};
    if (request.takesZstd) headers.emplace_back("Accept-Encoding", "zstd");
    headers.insert(headers.end(), request.headers.begin(), request.headers.end());
    if (!isOneLine(request.target)) return {};
    std::string head = (request.isPost ? "POST " : "GET ") + request.target + " HTTP/1.1\r\n";
    if (request.isPost) head += "Content-Length: " + std::to_string(request.form.size()) + "\r\n";
    if (!request.form.empty()) head += "Content-Type: application/x-www-form-urlencoded\r\n";
    for (const auto& [name, value] : headers) {
        if (!isOneLine(name) || !isOneLine(value)) return {};
        head += name + ": " + value + "\r\n";
    }
    return head + "\r\n" + (request.isPost ? request.form : "");
}

}  // namespace

std::string_view HttpAnswer::header(std::string_view name) const {
    for (const auto& [known, value] : headers)
        if (boost::beast::iequals({known.data(), known.size()}, {name.data(), name.size()}))
            return value;
    return {};
}

std::string HttpAnswer::etag() const {
    std::string_view etag = header("ETag");
    if (etag.size() >= 2 && etag.front() == '"') etag = etag.substr(1, etag.size() - 2);
    return std::string(etag);
}

/// One request and its answer.
class HttpClient::Exchange {
public:
    Exchange(Line& line, const HttpRequest& request, const HttpLimits& limits, Line::Time end)
        : line_(line), request_(request), limits_(limits), end_(end) {
        parser_.header_limit(kMostHeaderBytes);
        parser_.body_limit(boost::none);
    }

    [[nodiscard]] Fetched<HttpAnswer> run() {
        const std::string head = headOf(request_);
        if (head.empty()) return failed("the request has a line break in its address or a header");
        const auto answerBy = before(limits_.answer);
        if (const error_code error = line_.write(head, answerBy)) return broken(error);
        if (auto read = readHead(answerBy); !read) return tl::unexpected(std::move(read.error()));
        HttpAnswer answer{parser_.get().result_int()};
        for (const auto& field : parser_.get())
            answer.headers.emplace_back(text(field.name_string()), text(field.value()));
        if (std::string problem = readBody(answer); !problem.empty()) {
            Failure failure{std::move(problem)};
            failure.isUnreachable = isLate_;
            return tl::unexpected(std::move(failure));
        }
        return answer;
    }

    /// Returns whether the server has answered with at least one byte.
    [[nodiscard]] bool hasBegun() const { return hasBegun_; }
    /// Returns whether the next request can follow on this connection.
    [[nodiscard]] bool isKept() const {
        return isComplete_ && early_.empty() && parser_.keep_alive();
    }

private:
    [[nodiscard]] Line::Time before(milliseconds limit) const {
        return std::min(end_, steady_clock::now() + limit);
    }

    /// Returns the reason for an error of the connection.
    [[nodiscard]] std::string reason(const error_code& error) const {
        if (error == asio::error::timed_out && steady_clock::now() >= end_)
            return "no complete answer within " + std::to_string(limits_.whole->count()) + " ms";
        return causeOf(error);
    }
    [[nodiscard]] tl::unexpected<Failure> broken(const error_code& error) const {
        return unreachable("no answer: " + reason(error), error);
    }

    [[nodiscard]] Fetched<void> readHead(Line::Time answerBy) {
        while (!parser_.is_header_done()) {
            if (const error_code error = readMore(answerBy)) return broken(error);
            error_code error;
            take(parser_.put(asio::buffer(early_), error));
            if (error && error != http::error::need_more)
                return failed("no answer: " + error.message());
        }
        return {};
    }

    /// Reads into early_.
    [[nodiscard]] error_code readMore(Line::Time end) {
        const std::size_t before = early_.size();
        early_.resize(before + kReadBytes);
        const auto count = line_.read(std::span(early_).subspan(before), end);
        early_.resize(before + count.value_or(0));
        hasBegun_ = hasBegun_ || count;
        return count ? error_code() : count.error();
    }
    void take(std::size_t count) { early_.erase(0, count); }

    /// Returns the reason why the body is not complete.
    [[nodiscard]] std::string readBody(HttpAnswer& answer) {
        const bool isGood = answer.status == kOk || answer.status == kPartial;
        if (answer.status == kNotModified || answer.status == kNoContent) {
            isComplete_ = true;
            return {};
        }
        const std::uint64_t most = isGood ? limits_.bodyBytes : kMostReasonBytes;
        BodyInMemory body(answer.body, most);
        const bool goesToSink = request_.sink && isGood;
        if (!goesToSink && parser_.content_length().value_or(0) > most)
            return isGood ? tooLarge(most) : "";
        std::string problem = decode(goesToSink ? *request_.sink : body);
        if (isGood || !body.isTooLarge()) return problem;
        answer.body.clear();
        return {};
    }

    [[nodiscard]] std::string decode(BodySink& sink) {
        const auto encoding = parser_.get()[http::field::content_encoding];
        if (encoding.empty()) return read(sink);
        if (encoding != "zstd") return "the answer has the unknown encoding " + text(encoding);
        Inflated inflated(sink);
        std::string problem = read(inflated);
        return problem.empty() ? inflated.finish() : problem;
    }

    [[nodiscard]] std::string read(BodySink& sink) {
        partBy_ = before(limits_.stall);
        const auto length = parser_.content_length();
        std::string problem = length ? readLength(sink, *length) : readToEnd(sink);
        isComplete_ = problem.empty();
        return problem;
    }

    /// Reads a body of known length from the connection into the sink, without the parser between
    /// them.
    [[nodiscard]] std::string readLength(BodySink& sink, std::uint64_t left) {
        while (left > 0) {
            std::span<char> space = sink.space();
            space = space.first(std::min<std::uint64_t>(space.size(), left));
            std::size_t size = early_.copy(space.data(), space.size());
            take(size);
            if (size == 0) {
                const auto count = line_.read(space, partBy_);
                if (!count) return ended(count.error());
                size = *count;
            }
            if (std::string problem = add(sink, size); !problem.empty()) return problem;
            left -= size;
        }
        return {};
    }

    /// Reads a body in chunks, or one that ends with the connection.
    [[nodiscard]] std::string readToEnd(BodySink& sink) {
        for (bool needsMore = early_.empty(); !parser_.is_done();) {
            if (needsMore) {
                const error_code error = readMore(partBy_);
                if (error == asio::error::eof) {
                    error_code ignored;
                    parser_.put_eof(ignored);
                    if (parser_.is_done()) return {};
                }
                if (error) return ended(error);
            }
            const std::span<char> space = sink.space();
            parser_.get().body() = {space.data(), space.size(), true};
            error_code error;
            const std::size_t used = parser_.put(asio::buffer(early_), error);
            take(used);
            if (error && error != http::error::need_more && error != http::error::need_buffer)
                return "the answer is malformed: " + error.message();
            const std::size_t filled = space.size() - parser_.get().body().size;
            if (std::string problem = add(sink, filled); !problem.empty()) return problem;
            needsMore = early_.empty() || (used == 0 && filled == 0);
            if (needsMore && early_.size() > kMostHeaderBytes) return "the answer is malformed";
        }
        return {};
    }

    [[nodiscard]] std::string add(BodySink& sink, std::size_t size) {
        part_ += size;
        isLate_ = part_ < kPartBytes && steady_clock::now() > partBy_;
        if (isLate_) return slow();
        std::string problem = sink.add(size);
        if (part_ >= kPartBytes) {
            partBy_ = before(limits_.stall);
            part_ = 0;
        }
        return problem;
    }

    [[nodiscard]] std::string ended(const error_code& error) {
        isLate_ = error == asio::error::timed_out;
        return isLate_ ? slow() : reason(error);
    }
    [[nodiscard]] std::string slow() const {
        return steady_clock::now() >= end_ ? reason(asio::error::timed_out) : "it sends too slowly";
    }

    Line& line_;
    const HttpRequest& request_;
    const HttpLimits& limits_;
    const Line::Time end_;
    http::response_parser<http::buffer_body> parser_;
    std::string early_;  // arrived, and not read yet
    Line::Time partBy_;
    std::uint64_t part_ = 0;
    bool hasBegun_ = false, isComplete_ = false, isLate_ = false;
};

HttpClient::HttpClient(HttpLimits limits, std::function<bool()> isStopped)
    : limits_(limits), isStopped_(std::move(isStopped)) {}

HttpClient::~HttpClient() = default;

Fetched<HttpAnswer> HttpClient::get(const HttpRequest& request) try {
    const auto end = limits_.whole ? steady_clock::now() + *limits_.whole : Line::Time::max();
    if (line_ && !line_->isFor(request)) line_.reset();
    for (;;) {
        const bool wasKept = line_ != nullptr;
        if (!wasKept) {
            line_ = std::make_unique<Line>(request.origin, request.trust, isStopped_);
            if (auto connected = line_->connect(limits_.connect, end); !connected) {
                line_.reset();
                return tl::unexpected(std::move(connected.error()));
            }
        }
        Exchange exchange(*line_, request, limits_, end);
        auto answer = exchange.run();
        if (!answer || !exchange.isKept()) line_.reset();
        const bool isEnded =
            !answer && (answer.error().error == ETIMEDOUT || answer.error().error == ECANCELED);
        const bool wasClosed = !answer && wasKept && !exchange.hasBegun() && !isEnded;
        if (!wasClosed) return answer;
    }
} catch (const std::exception& fault) {
    line_.reset();
    return failed(fault.what());
}

Fetched<HttpAnswer> get(const HttpRequest& request, const HttpLimits& limits,
                        std::function<bool()> isStopped) {
    return HttpClient(limits, std::move(isStopped)).get(request);
}

std::string formOf(const HttpHeaders& fields) {
    std::string form;
    for (const auto& [name, value] : fields)
        form += (form.empty() ? "" : "&") + urlEncoded(name) + "=" + urlEncoded(value);
    return form;
}

std::string urlEncoded(const std::string& text) {
    return percentEncodedIf(text, [](char c) {
        const bool isLetter =
            (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        return !isLetter && std::string_view("-._~/").find(c) == std::string_view::npos;
    });
}

}  // namespace usdlive::fetch
