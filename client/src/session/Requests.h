// The requests of a session that the server has not answered yet.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

#include "session/Channel.h"
#include "session/SessionEvents.h"

namespace usdlive::client {

/// Numbers requests and finds the request that an answer or an error ends.
///
/// Each request ends once: with its answer, an error of the server, or endAll() when the connection
/// is lost.
class Requests {
public:
    Requests(Channel& channel, SessionEvents& events) : channel_(channel), events_(events) {}

    /// See Session::request().
    std::uint64_t request(AnyRequest request);
    /// See Session::requestLog().
    void requestLog(Revision from, Revision to, std::function<void(const Commit&)> each,
                    std::function<void(Result<void>)> done);

    // For requests that are answered by more than one message.
    /// The answer, or an error message that names the request.
    template <class Answer>
    using Outcome = tl::expected<Answer, ErrorMessage>;
    template <IsRequest Request>
    using Ended = std::function<void(Outcome<typename Request::Answer>)>;

    /// Returns a number that no other request of this session has.
    [[nodiscard]] std::uint64_t nextNumber() { return ++last_; }
    /// Returns why a request cannot be sent now.
    [[nodiscard]] std::optional<ErrorMessage> whyNot(std::uint64_t number, std::string_view type,
                                                     std::string_view feature = {}) const;
    /// Adds a request that the caller sends. `ended` is called once. It may add requests.
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
    /// Removes a request that ended otherwise: the frames that answer it are complete.
    void forget(std::uint64_t number) { pending_.erase(number); }

    /// Ends a request. Returns false if it is not pending.
    bool end(std::uint64_t number, Outcome<ControlMessage> outcome);
    /// Ends all requests with NotConnected.
    void endAll(const std::string& why);
    void received(const LogBegin& message);
    /// Returns whether the commit is of the past and answers requestLog().
    bool takes(const Commit& commit);

private:
    struct LogReader {
        std::uint64_t request = 0;
        bool begun = false;
        std::function<void(const Commit&)> each;
    };

    template <class Request>
    std::uint64_t send(Request& request);
    [[nodiscard]] static ErrorMessage errorOf(std::uint64_t number, ErrorCode code,
                                              std::string message);
    [[nodiscard]] static ErrorMessage anotherType(std::uint64_t number, std::string_view request);

    Channel& channel_;
    SessionEvents& events_;
    std::uint64_t last_ = 0;
    std::map<std::uint64_t, std::function<void(Outcome<ControlMessage>)>> pending_;
    std::deque<LogReader> logs_;
};

}  // namespace usdlive::client
