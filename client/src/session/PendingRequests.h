// The requests of one connection that the server has not answered yet.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <variant>

#include "usdlive/common/core/Result.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::client {

/// Numbers requests and finds the request that an answer or an error ends.
///
/// Each request ends once: with its answer, an error of the server, or endAll() when the connection
/// is lost.
class PendingRequests {
public:
    /// The answer, or an error message that names the request.
    template <class Answer>
    using Outcome = tl::expected<Answer, ErrorMessage>;
    template <IsRequest Request>
    using Ended = std::function<void(Outcome<typename Request::Answer>)>;

    /// A number that no other request of this session has.
    [[nodiscard]] std::uint64_t nextNumber() { return ++last_; }

    /// `ended` is called once. It may add requests.
    template <IsRequest Request>
    void add(const Request& request, Ended<Request> ended) {
        pending_[request.request] = [number = request.request,
                                     ended = std::move(ended)](Outcome<ControlMessage> outcome) {
            using Answer = typename Request::Answer;
            if (!outcome) return ended(tl::unexpected(std::move(outcome.error())));
            if (auto* answer = std::get_if<Answer>(&*outcome)) return ended(std::move(*answer));
            ended(tl::unexpected(anotherType(number, Request::kType)));
        };
    }

    /// Ends a request. False: it is not pending.
    bool end(std::uint64_t number, Outcome<ControlMessage> outcome) {
        auto found = pending_.extract(number);
        if (found) found.mapped()(std::move(outcome));
        return !found.empty();
    }

    /// Removes a request that ended otherwise: the frames that answer it are complete.
    void forget(std::uint64_t number) { pending_.erase(number); }

    /// Ends all requests with NotConnected.
    void endAll(const std::string& why) {
        for (auto& [number, ended] : std::exchange(pending_, {}))
            ended(tl::unexpected(errorOf(number, ErrorCode::NotConnected, why)));
    }

    /// An error message about a request.
    [[nodiscard]] static ErrorMessage errorOf(std::uint64_t number, ErrorCode code,
                                              std::string message) {
        ErrorMessage error;
        error.code = errorName(code);
        error.message = std::move(message);
        error.request = number;
        return error;
    }

private:
    static ErrorMessage anotherType(std::uint64_t number, std::string_view request) {
        return errorOf(number, ErrorCode::MalformedControl,
                       "the server answered the request '" + std::string(request) +
                           "' with a message of another type");
    }

    std::uint64_t last_ = 0;
    std::map<std::uint64_t, std::function<void(Outcome<ControlMessage>)>> pending_;
};

}  // namespace usdlive::client
