// Waits for Asio's operations, one at a time.
#include "Line.h"

#include <fcntl.h>

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/error.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <optional>
#include <vector>

#include "usdlive/common/net/ClientTls.h"

namespace usdlive::fetch {

namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// The time until a request notices that it is stopped.
constexpr milliseconds kNotice{50};

/// async_resolve() would start a thread, which may be refused.
std::vector<tcp::endpoint> endpointsOf(const Origin& origin, asio::io_context& io,
                                       error_code& error) {
    if (origin.host == "localhost")  // without a name server
        return {{asio::ip::address_v4::loopback(), origin.port},
                {asio::ip::address_v6::loopback(), origin.port}};
    std::vector<tcp::endpoint> endpoints;
    for (const auto& one :
         tcp::resolver(io).resolve(origin.host, std::to_string(origin.port), error))
        endpoints.push_back(one.endpoint());
    return endpoints;
}

ClientTls::Trust trustOf(Trust trust) {
    switch (trust) {
        case Trust::Known:
            return ClientTls::Trust::Known;
        case Trust::FirstUse:
            return ClientTls::Trust::FirstUse;
        default:
            return ClientTls::Trust::Authorities;
    }
}

}  // namespace

std::string causeOf(const error_code& error) {
    if (error == asio::error::timed_out) return "it did not respond in time";
    if (error == asio::error::eof) return "the connection ended before the end";
    return error.message();
}

tl::unexpected<Failure> unreachable(std::string cause, const error_code& error) {
    const bool isOfSystem = error.category() == boost::system::system_category();
    return tl::unexpected(
        Failure{std::move(cause), 0, isOfSystem ? error.value() : 0, /* isUnreachable = */ true});
}

template <class Start>
error_code HttpClient::Line::wait(Start start, Time end) {
    std::optional<error_code> result;
    error_code why;
    start([&](error_code error) { result = error; });
    for (io_.restart(); !result.has_value(); io_.restart()) {
        const auto left = end - steady_clock::now();
        if (!why && isStopped_ && isStopped_()) why = asio::error::operation_aborted;
        if (!why && left <= left.zero()) why = asio::error::timed_out;
        if (why) stream_.close();  // ends the operation
        io_.run_one_for(std::min<steady_clock::duration>(why ? kNotice : left, kNotice));
    }
    return why ? why : *result;
}

Fetched<void> HttpClient::Line::connect(milliseconds limit, Time end) {
    error_code first;
    const auto endpoints = endpointsOf(origin_, io_, first);
    if (first) return unreachable("no address was found for the host: " + first.message());
    for (const tcp::endpoint& endpoint : endpoints) {
        const Time until = std::min(end, steady_clock::now() + limit);
        error_code error;
        stream_ = NetStream(io_);  // the one before may be of the other family
        stream_.socket().open(endpoint.protocol(), error);
        if (!error)
            error =
                wait([&](auto done) { stream_.socket().async_connect(endpoint, std::move(done)); },
                     until);
        if (!error) {
            stream_.socket().set_option(tcp::no_delay(true), error);
            ::fcntl(stream_.socket().native_handle(), F_SETFD, FD_CLOEXEC);
            return origin_.isSecure ? handshake(until) : Fetched<void>();
        }
        if (!first) first = error;
        if (error == asio::error::operation_aborted) break;
    }
    return unreachable(causeOf(first), first);
}

Fetched<void> HttpClient::Line::handshake(Time end) {
    ClientTls tls(KnownServers(), origin_.host, origin_.port, trustOf(trust_));
    if (auto begun = tls.encrypt(stream_); !begun) return failed(begun.error().message);
    const error_code error =
        wait([&](auto done) { stream_.async_handshake(std::move(done)); }, end);
    if (auto checked = tls.check(error); !checked)
        return unreachable(std::move(checked.error().message), error);
    return {};
}

tl::expected<std::size_t, error_code> HttpClient::Line::read(std::span<char> space, Time end) {
    std::size_t count = 0;
    const error_code error = wait(
        [&](auto done) {
            stream_.async_read_some(asio::buffer(space.data(), space.size()),
                                    [done, &count](error_code ended, std::size_t size) mutable {
                                        count = size;
                                        done(ended);
                                    });
        },
        end);
    if (count > 0) return count;
    return tl::unexpected(error);
}

error_code HttpClient::Line::write(std::string_view text, Time end) {
    while (!text.empty()) {
        std::size_t count = 0;
        const error_code error = wait(
            [&](auto done) {
                stream_.async_write_some(
                    asio::buffer(text.data(), text.size()),
                    [done, &count](error_code ended, std::size_t size) mutable {
                        count = size;
                        done(ended);
                    });
            },
            end);
        if (error) return error;
        text.remove_prefix(count);
    }
    return {};
}

}  // namespace usdlive::fetch
