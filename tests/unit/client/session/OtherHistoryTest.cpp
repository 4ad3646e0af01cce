// Tests what a session does when the server has another history (ID2-ID4).
#include <gtest/gtest.h>

#include <algorithm>

#include "SessionPeer.h"

using namespace usdlive;
using namespace usdlive::client;
using namespace usdlive::client::sessiontest;

namespace {

class OtherHistory : public ::testing::Test {
protected:
    // An editor with an acknowledged comment, and one that was not sent, is away.
    void SetUp() override {
        peer.commit(peer.foreign({edit("/A", createPrim()), edit("/A", setText("kind", "old"))}));
        peer.connectAndJoin();
        peer.author({authored("/A", setText("comment", "told"))});
        peer.advance();
        peer.commitAndTell(peer.takeTransaction());
        peer.advance();
        ASSERT_EQ(peer.session.pendingTransactions(), 0u);
        goAway();
        peer.author({authored("/A", setText("documentation", "unsent"))});
    }
    void goAway() {
        peer.session.disconnected({ErrorCode::NotConnected, "away"});
        peer.advance();
        peer.events.clear();
    }
    /// Replaces the server by one with another history that has as many commits.
    void serve(StoreId store, std::string project, const std::string& kind) {
        own = {peer.store, peer.project, peer.docs, peer.log, peer.creations, peer.history};
        peer.store = std::move(store);
        peer.project = std::move(project);
        peer.docs = {{kShot, {}}};
        peer.log = {};
        peer.creations = {};
        peer.history = {};
        peer.commit(peer.foreign({edit("/A", createPrim()), edit("/A", setText("kind", kind))}));
        peer.commit(peer.foreign({edit("/New", createPrim())}));
    }
    void serveCopy() { serve(peer.store, peer.project, "restored"); }
    void serveOtherProject() { serve({"other"}, "s020", "of the other"); }
    void serveOwn() {
        std::tie(peer.store, peer.project, peer.docs, peer.log, peer.creations, peer.history) = own;
    }
    /// Connects to a server that has another history, as SE2 says.
    void find(const char* code = "historyDiverged") {
        peer.sent.clear();
        peer.reader.emplace();
        peer.session.connected();
        const auto hello = peer.takeControl<Hello>();
        ASSERT_TRUE(hello && hello->resume);
        EXPECT_EQ(hello->resume->store, std::get<0>(own));
        peer.deliver(ErrorMessage{code, "another", false, {}, {}});
        peer.deliver(peer.welcomeMessage(false));
        peer.advance();
    }
    void expectStopped() {
        EXPECT_FALSE(peer.session.isConnected());
        ASSERT_TRUE(peer.session.otherHistory());
        const auto errors = peer.eventsOf<event::ServerError>();
        ASSERT_EQ(errors.size(), 1u);
        EXPECT_TRUE(errors[0].message.closing);
        EXPECT_EQ(errors[0].message.code, "historyDiverged");
        EXPECT_EQ(errors[0].message.message, peer.session.otherHistory()->reason.message);
        EXPECT_TRUE(peer.sent.empty()) << "nothing is sent";
        EXPECT_EQ(peer.session.pendingTransactions(), 1u);
        EXPECT_EQ(peer.text("/A", "comment"), "told");
        EXPECT_EQ(peer.text("/A", "documentation"), "unsent");
        EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
    }
    void joinFound() {
        ASSERT_TRUE(peer.session.joinOtherHistory());
        goAway();
        find();
        EXPECT_FALSE(peer.session.otherHistory());
        peer.sendSnapshot(*peer.takeControl<OpenLayer>());
        peer.advance();
    }
    /// Returns the lost texts of /A, by field.
    std::map<std::string, std::string> lostTexts() const {
        std::map<std::string, std::string> texts;
        for (const event::Lost& lost : peer.eventsOf<event::Lost>())
            for (const AuthoredEdit& edit : lost.work.edits)
                if (const auto* set = std::get_if<SetField>(&edit.action); set && edit.path == "/A")
                    texts[set->field] = textOf(*set->value.as<Value>()).value_or("?");
        return texts;
    }

    SessionPeer peer;
    std::tuple<StoreId, std::string, LayerDocs, NamespaceLog, std::map<ClientId, OwnCreations>,
               std::vector<std::pair<Bytes, Hash>>>
        own;
};

TEST_F(OtherHistory, ID2AnotherProjectStopsTheSession) {
    serveOtherProject();
    find();
    expectStopped();
    EXPECT_TRUE(peer.session.otherHistory()->isOtherProject());
    EXPECT_EQ(peer.session.otherHistory()->expectedProject, "test");
    EXPECT_EQ(peer.session.otherHistory()->foundProject, "s020");
    const std::string& message = peer.session.otherHistory()->reason.message;
    for (const char* word : {"another project", "\"s020\"", "\"test\"", "Nothing was sent",
                             "join_other_history", "unsent_work"})
        EXPECT_NE(message.find(word), std::string::npos) << word << " in " << message;
}

// A server of an earlier version does not compare the stores; the client does.
TEST_F(OtherHistory, ID2AnotherProjectIsNoticedWithoutTheServersHelp) {
    serveOtherProject();
    peer.history[1].second = std::get<5>(own)[1].second;
    peer.sent.clear();
    peer.reader.emplace();
    peer.session.connected();
    (void)peer.takeControl<Hello>();
    peer.deliver(peer.welcomeMessage(true));
    peer.advance();
    expectStopped();
}

TEST_F(OtherHistory, ID2AnotherHashOrAMissingRevisionStopsTheSession) {
    serveCopy();
    for (const char* code : {"historyDiverged", "futureRevision"}) {
        find(code);
        expectStopped();
        EXPECT_FALSE(peer.session.otherHistory()->isOtherProject());
        goAway();
    }
}

TEST_F(OtherHistory, ID2WorkContinuesWhenTheRightServerIsBack) {
    serveOtherProject();
    find();
    peer.author({authored("/A", setText("kind", "meanwhile"))});
    goAway();
    serveOwn();
    EXPECT_EQ(peer.connect().resume->store, peer.store);
    peer.advance();
    EXPECT_FALSE(peer.session.otherHistory());
    peer.commitAndTell(peer.takeTransaction());
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_TRUE(peer.agrees());
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
}

TEST_F(OtherHistory, ID4WhatARestoredCopyLacksBecomesLostWorkAndUnsentWorkIsSent) {
    serveCopy();
    find();
    joinFound();
    EXPECT_EQ(lostTexts(),
              (std::map<std::string, std::string>{{"comment", "told"}, {"kind", "old"}}));
    EXPECT_EQ(peer.text("/A", "kind"), "restored");
    EXPECT_EQ(peer.text("/A", "comment"), "-");
    EXPECT_EQ(peer.text("/A", "documentation"), "unsent");
    const Transaction own = peer.takeTransaction();
    EXPECT_EQ(own.base, peer.head());
    peer.commitAndTell(own);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(OtherHistory, ID3UnsentWorkDoesNotReachAnotherProject) {
    serveOtherProject();
    find();
    peer.session.beginGesture();
    peer.author({authored("/A", setText("kind", "dragged"))});
    joinFound();
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_FALSE(peer.take<SubmitFrame>());
    const auto lost = lostTexts();
    EXPECT_EQ(lost.at("documentation"), "unsent");
    EXPECT_EQ(lost.at("comment"), "told");
    EXPECT_EQ(lost.at("kind"), "old");
    const auto all = peer.eventsOf<event::Lost>();
    EXPECT_EQ(std::ranges::count_if(all, [](const event::Lost& one) { return one.work.refused; }),
              2)
        << "the transaction and the open gesture";
    EXPECT_EQ(peer.text("/A", "kind"), "of the other");
    EXPECT_TRUE(peer.agrees());
    // New work belongs to the project that was joined.
    peer.author({authored("/A", setText("comment", "new"))});
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

// The decision is for what was found, and not for what is served when the client connects again.
TEST_F(OtherHistory, ID4ADecisionIsForTheHistoryThatWasFound) {
    EXPECT_EQ(peer.session.joinOtherHistory().error().code, ErrorCode::InvalidArgument);
    serveOtherProject();
    find();
    ASSERT_TRUE(peer.session.joinOtherHistory());
    goAway();
    peer.store = {"third"};
    find();
    expectStopped();
}

TEST_F(OtherHistory, ID4ALayerThatTheOtherHistoryDoesNotHaveBecomesLostWork) {
    serveOtherProject();
    find();
    ASSERT_TRUE(peer.session.joinOtherHistory());
    goAway();
    find();
    const auto open = peer.takeControl<OpenLayer>();
    peer.deliver(ErrorMessage{"layerNotFound", "no such layer", false, open->request, {}});
    peer.advance();
    ASSERT_EQ(peer.eventsOf<event::JoinFailed>().size(), 1u);
    EXPECT_EQ(lostTexts().at("comment"), "told");
}

// The layers are still on their way when the connection is lost, and the right server is back.
TEST_F(OtherHistory, ID4NothingIsLostWhenJoiningIsInterrupted) {
    serveOtherProject();
    find();
    ASSERT_TRUE(peer.session.joinOtherHistory());
    goAway();
    find();
    EXPECT_EQ(peer.text("/A", "comment"), "told") << "shown until the other history is here";
    goAway();
    std::get<0>(own) = peer.store;
    peer.store = {"0123456789abcdef0123456789abcdef"};
    find();
    ASSERT_TRUE(peer.session.otherHistory());
    ASSERT_TRUE(peer.session.joinOtherHistory());
    goAway();
    find();
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    peer.advance();
    EXPECT_EQ(lostTexts().at("comment"), "told");
}

// M14: hello says since when own work is unanswered, and still resumes where the client is.
TEST_F(OtherHistory, M14ASessionWithUnansweredWorkResumesWhereItIs) {
    peer.connect();
    peer.advance();
    (void)peer.takeTransaction();  // sent, and its answer is lost
    const Revision since = peer.head();
    goAway();
    peer.commit(peer.foreign({edit("/B", createPrim())}));
    peer.sent.clear();
    peer.reader.emplace();
    peer.session.connected();
    EXPECT_FALSE(peer.takeControl<Hello>()->resume->unansweredSince);
    peer.deliver(peer.welcomeMessage(false));  // too old to resume
    peer.advance();
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    peer.advance();
    goAway();
    const Hello hello = peer.connect();
    EXPECT_EQ(hello.resume->revision, peer.head());
    EXPECT_EQ(hello.resume->unansweredSince, since);
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

// Otherwise a server that has forgotten the client commits what is sent again a second time.
TEST_F(OtherHistory, M14WorkIsUnansweredSinceAShorterHistoryWasJoined) {
    peer.connect();
    peer.advance();
    (void)peer.takeTransaction();  // sent, and its answer is lost
    peer.commitAndTell(peer.foreign({edit("/B", createPrim())}));
    peer.advance();
    const Revision left = peer.head();
    goAway();
    serveCopy();
    const Revision joined = peer.head();
    ASSERT_LT(joined, left);
    find("futureRevision");
    joinFound();
    (void)peer.takeTransaction();  // sent again, and the answer is lost
    peer.commit(peer.foreign({edit("/B", createPrim())}));
    goAway();
    peer.sent.clear();
    peer.reader.emplace();
    peer.session.connected();
    const auto hello = peer.takeControl<Hello>();
    EXPECT_EQ(hello->resume->revision, joined);
    EXPECT_EQ(hello->resume->unansweredSince, joined);
}

}  // namespace
