// Tests that each request ends once (RQ1): every one of the declaration
// (common/protocol/Requests.h) in every way that it can end.
#include <gtest/gtest.h>

#include "SessionPeer.h"

namespace usdlive::client::sessiontest {
namespace {

/// A request that a server can read.
template <class Request>
Request sample() {
    Request request;
    if constexpr (requires { request.layer; }) request.layer = {"new.usda"};
    return request;
}

/// A connected session, and how a request of it has ended.
struct Asking : SessionPeer {
    Asking() {
        features = protocolFeatures();
        connectAndJoin();
    }

    template <class Request>
    std::uint64_t ask() {
        const std::uint64_t number = session.request(sample<Request>());
        advance();
        return number;
    }
    template <class Request>
    [[nodiscard]] std::size_t answersTo(std::uint64_t number) const {
        const auto all = eventsOf<event::Answered<Request>>();
        return std::ranges::count_if(all,
                                     [&](const auto& one) { return one.answer.request == number; });
    }
    [[nodiscard]] std::vector<std::string> errorsOf(std::uint64_t number) const {
        std::vector<std::string> codes;
        for (const auto& error : eventsOf<event::ServerError>())
            if (error.message.request == number) codes.push_back(error.message.code);
        return codes;
    }
    template <class Request>
    void expectError(std::uint64_t number, ErrorCode code) {
        EXPECT_EQ(errorsOf(number), std::vector{std::string(errorName(code))});
        EXPECT_EQ(answersTo<Request>(number), 0u);
    }
    void loseConnection() {
        session.disconnected({ErrorCode::NotConnected, "away"});
        advance();
    }
};

template <class Test>
void forEachKind(Test test) {
    forEachRequest([&]<class Request>(const Request&) {
        SCOPED_TRACE(Request::kType);
        Asking peer;
        test.template operator()<Request>(peer);
    });
}

TEST(SessionRequests, RQ1AnAnswerEndsARequest) {
    forEachKind([]<class Request>(Asking& peer) {
        const auto number = peer.ask<Request>();
        const auto sent = peer.takeControl<Request>();
        ASSERT_TRUE(sent);
        EXPECT_EQ(sent->request, number);
        typename Request::Answer answer;
        answer.request = number;
        if constexpr (requires { answer.layer; }) answer.layer = {"new.usda"};
        peer.deliver(answer);
        peer.deliver(answer);  // a second one ends nothing
        peer.advance();
        peer.loseConnection();
        EXPECT_EQ(peer.answersTo<Request>(number), 1u);
        EXPECT_TRUE(peer.errorsOf(number).empty());
    });
}

TEST(SessionRequests, RQ1AnErrorEndsARequest) {
    forEachKind([]<class Request>(Asking& peer) {
        const auto number = peer.ask<Request>();
        peer.deliver(ErrorMessage{"storageFailed", "broken", false, number, {}});
        peer.advance();
        peer.loseConnection();
        peer.template expectError<Request>(number, ErrorCode::StorageFailed);
    });
}

TEST(SessionRequests, RQ1TheLossOfTheConnectionEndsARequest) {
    forEachKind([]<class Request>(Asking& peer) {
        const auto number = peer.ask<Request>();
        peer.loseConnection();
        peer.template expectError<Request>(number, ErrorCode::NotConnected);
        peer.connect();
        peer.advance();
        EXPECT_FALSE(peer.takeControl<Request>()) << "it is not sent again";
    });
}

TEST(SessionRequests, RQ1AnErrorThatWasNotReadBeforeTheLossCounts) {
    forEachKind([]<class Request>(Asking& peer) {
        const auto number = peer.ask<Request>();
        peer.deliver(ErrorMessage{"storageFailed", "broken", false, number, {}});
        peer.loseConnection();
        peer.template expectError<Request>(number, ErrorCode::StorageFailed);
    });
}

TEST(SessionRequests, RQ1AnotherConnectionEndsARequest) {
    forEachKind([]<class Request>(Asking& peer) {
        const auto number = peer.ask<Request>();
        peer.connect();  // nobody reported the loss of the one before
        peer.advance();
        peer.template expectError<Request>(number, ErrorCode::NotConnected);
    });
}

TEST(SessionRequests, RQ1ARequestWithoutAConnectionEndsAtOnce) {
    forEachKind([]<class Request>(Asking& peer) {
        peer.loseConnection();
        peer.sent.clear();
        const auto number = peer.ask<Request>();
        peer.template expectError<Request>(number, ErrorCode::NotConnected);
        EXPECT_FALSE(peer.takeControl<Request>());
    });
}

TEST(SessionRequests, RQ1AnAnswerOfAnotherTypeEndsARequest) {
    forEachKind([]<class Request>(Asking& peer) {
        const auto number = peer.ask<Request>();
        if constexpr (std::is_same_v<Request, ListCheckpoints>)
            peer.deliver(SkippedFiles{number, 0, {}});
        else
            peer.deliver(Checkpoints{number, {}});
        peer.advance();
        peer.template expectError<Request>(number, ErrorCode::MalformedControl);
    });
}

TEST(SessionRequests, PR1AnOlderServerIsNotAskedWhatItDoesNotKnow) {
    forEachKind([]<class Request>(Asking& peer) {
        const std::string feature(featureOf<Request>());
        peer.loseConnection();
        std::erase(peer.features, feature);
        peer.connect();
        peer.advance();
        const auto number = peer.ask<Request>();
        EXPECT_EQ(peer.takeControl<Request>().has_value(), feature.empty());
        if (!feature.empty())
            peer.template expectError<Request>(number, ErrorCode::UnsupportedProtocol);
    });
}

TEST(SessionRequests, ARequestThatAServerCannotReadIsNotSent) {
    Asking peer;
    const auto number = peer.session.request(CreateLayer{.layer = {"../x.usda"}});
    peer.advance();
    peer.expectError<CreateLayer>(number, ErrorCode::InvalidLayerName);
    EXPECT_FALSE(peer.takeControl<CreateLayer>());
    EXPECT_TRUE(peer.session.isConnected());
}

TEST(SessionRequests, RQ1TheLossOfTheConnectionEndsAPeekAndALog) {
    Asking peer;
    std::vector<ErrorCode> ended;
    const auto ask = [&] {
        peer.session.peek(kLook, 0, [&](const Result<LayerDoc>& doc, Revision) {
            ended.push_back(doc.error().code);
        });
        peer.session.requestLog(
            1, 0, [](const Commit&) {},
            [&](const Result<void>& read) { ended.push_back(read.error().code); });
    };
    ask();
    EXPECT_TRUE(ended.empty());
    peer.loseConnection();
    EXPECT_EQ(ended, (std::vector{ErrorCode::NotConnected, ErrorCode::NotConnected}));
    ask();
    EXPECT_EQ(ended.size(), 4u) << "without a connection at once";
    peer.connect();
    peer.advance();
    EXPECT_FALSE(peer.takeControl<OpenLayer>() && peer.takeControl<RequestLog>());
    EXPECT_EQ(ended.size(), 4u);
}

}  // namespace
}  // namespace usdlive::client::sessiontest
