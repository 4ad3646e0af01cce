// Sends requests and ends them.
#include "session/Requests.h"

#include <algorithm>

#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::client {

std::uint64_t Requests::request(AnyRequest request) {
    return std::visit([this](auto& each) { return send(each); }, request);
}

template <class Request>
std::uint64_t Requests::send(Request& request) {
    request.request = nextNumber();
    auto refused = whyNot(request.request, Request::kType, featureOf<Request>());
    // The server would end the session over a request that it cannot read.
    auto control = encodeChecked(request);
    if (!control && !refused)
        refused = errorOf(request.request, control.error().code,
                          "the request '" + std::string(Request::kType) +
                              "' is not valid: " + control.error().message);
    if (refused) {
        events_.push(event::ServerError{*std::move(refused)});
        return request.request;
    }
    add(request, [this](auto outcome) {
        if (outcome)
            events_.push(event::Answered<Request>{std::move(*outcome)});
        else
            events_.push(event::ServerError{std::move(outcome.error())});
    });
    channel_.send(std::move(*control));
    return request.request;
}

// A server of an earlier version would end the session over a message that it does not know.
std::optional<ErrorMessage> Requests::whyNot(std::uint64_t number, std::string_view type,
                                             std::string_view feature) const {
    const std::string request = "the request '" + std::string(type) + "'";
    if (!channel_.isOnline())
        return errorOf(number, ErrorCode::NotConnected,
                       request + " needs a connection, and there is none");
    if (!feature.empty() && !channel_.knows(feature))
        return errorOf(
            number, ErrorCode::UnsupportedProtocol,
            "the server is of an earlier version, which does not know " + request + ": update it");
    return std::nullopt;
}

bool Requests::end(std::uint64_t number, Outcome<ControlMessage> outcome) {
    auto found = pending_.extract(number);
    if (found) found.mapped()(std::move(outcome));
    return !found.empty();
}

void Requests::endAll(const std::string& why) {
    for (auto& [number, ended] : std::exchange(pending_, {}))
        ended(tl::unexpected(errorOf(number, ErrorCode::NotConnected, why)));
}

// ---- commits of the past

void Requests::requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                          std::function<void(Result<void>)> done) {
    const RequestLog log{nextNumber(), from, to};
    if (const auto refused = whyNot(log.request, log.kType))
        return done(tl::unexpected(toError(*refused)));
    logs_.push_back({log.request, false, std::move(each)});
    add(log, [this, log, done = std::move(done)](const auto& outcome) {
        std::erase_if(logs_, [&](const LogReader& one) { return one.request == log.request; });
        if (outcome)
            done({});
        else
            done(tl::unexpected(toError(outcome.error())));
    });
    channel_.send(log);
}

void Requests::received(const LogBegin& message) {
    if (!logs_.empty() && logs_.front().request == message.request) logs_.front().begun = true;
}

bool Requests::takes(const Commit& commit) {
    if (logs_.empty() || !logs_.front().begun) return false;
    logs_.front().each(commit);
    return true;
}

ErrorMessage Requests::errorOf(std::uint64_t number, ErrorCode code, std::string message) {
    ErrorMessage error;
    error.code = errorName(code);
    error.message = std::move(message);
    error.request = number;
    return error;
}

ErrorMessage Requests::anotherType(std::uint64_t number, std::string_view request) {
    return errorOf(number, ErrorCode::MalformedControl,
                   "the server answered the request '" + std::string(request) +
                       "' with a message of another type");
}

}  // namespace usdlive::client
