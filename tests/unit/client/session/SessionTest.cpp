// Tests Session against a server that does only what a test requests.
#include "session/Session.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "SessionPeer.h"
#include "unit/Seeds.h"
#include "usdlive/common/protocol/CheckedControl.h"

using namespace usdlive;
using namespace usdlive::client;
using namespace usdlive::client::sessiontest;

namespace {

class SessionTest : public ::testing::Test {
protected:
    SessionPeer peer;

    // Joins a shot with a prim /A that has an attribute.
    void joinShot() {
        peer.commit(peer.foreign({edit("/A", createPrim()), edit("/A.x", createAttribute()),
                                  edit("/A", setText("comment", "first"))}));
        peer.connectAndJoin();
    }
    void answerOpenLayer() {
        const auto open = peer.takeControl<OpenLayer>();
        ASSERT_TRUE(open);
        peer.sendSnapshot(*open);
        peer.advance();
    }
    void authorComment(const std::string& path, const std::string& text) {
        peer.author({authored(path, setText("comment", text))});
        peer.advance();
    }
};

}  // namespace

// ---- the layers of the project

TEST_F(SessionTest, SE9TheListOfLayersIsKnownWithTheWelcomeAndFollows) {
    peer.session.connected();
    peer.deliver(LayerList{{{"a.usda"}, {"b.usda"}}, {}});
    peer.deliver(LayerList{{{"c.usda"}}, {}});
    peer.advance();
    EXPECT_TRUE(peer.session.projectLayers().empty()) << "the list is not complete";
    peer.deliver(peer.welcomeMessage(false));
    peer.advance();
    EXPECT_EQ(peer.session.projectLayers(),
              (std::set<LayerId>{{"a.usda"}, {"b.usda"}, {"c.usda"}}));
    EXPECT_EQ(peer.eventsOf<event::Connected>().at(0).newLayers.size(), 3u);
    EXPECT_TRUE(peer.eventsOf<event::LayersChanged>().empty());
    peer.deliver(LayerList{{{"d.usda"}}, {{"a.usda"}, {"x.usda"}}});
    peer.advance();
    const auto changed = peer.eventsOf<event::LayersChanged>();
    ASSERT_EQ(changed.size(), 1u);
    EXPECT_EQ(changed[0].added, std::vector<LayerId>{{"d.usda"}});
    EXPECT_EQ(changed[0].removed, std::vector<LayerId>{{"a.usda"}});

    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    EXPECT_EQ(peer.session.projectLayers().size(), 3u) << "still known";
    peer.session.connected();
    peer.deliver(LayerList{{{"d.usda"}, {"e.usda"}}, {}});
    peer.deliver(peer.welcomeMessage(true));
    peer.advance();
    EXPECT_EQ(peer.session.projectLayers(), (std::set<LayerId>{{"d.usda"}, {"e.usda"}}));
    EXPECT_EQ(peer.eventsOf<event::Connected>().at(1).newLayers, std::vector<LayerId>{{"e.usda"}});
}

TEST_F(SessionTest, SE9AListIsNotKeptFromAConnectionThatEndedBeforeTheWelcome) {
    peer.session.connected();
    peer.deliver(LayerList{{{"a.usda"}}, {}});
    peer.advance();
    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    peer.session.connected();
    peer.deliver(peer.welcomeMessage(false));
    peer.advance();
    EXPECT_TRUE(peer.session.projectLayers().empty());
}

TEST_F(SessionTest, SE9AServerWithoutTheFeatureSendsWholeLists) {
    peer.session.connected();
    Welcome welcome = peer.welcomeMessage(false);
    welcome.layers = {{{"a.usda"}}, {{"b.usda"}}};
    peer.deliver(welcome);
    peer.deliver(ProjectLayers{{{{"b.usda"}}, {{"c.usda"}}}});
    peer.advance();
    EXPECT_EQ(peer.session.projectLayers(), (std::set<LayerId>{{"b.usda"}, {"c.usda"}}));
    const auto changed = peer.eventsOf<event::LayersChanged>();
    ASSERT_EQ(changed.size(), 1u);
    EXPECT_EQ(changed[0].added, std::vector<LayerId>{{"c.usda"}});
    EXPECT_EQ(changed[0].removed, std::vector<LayerId>{{"a.usda"}});
}

TEST_F(SessionTest, SE2AListOfOpenLayersThatIsTooLongForAHelloIsContinued) {
    for (const bool isKnown : {true, false}) {
        SessionPeer peer;
        if (isKnown) peer.features.emplace_back(kLayerListFeature);
        std::set<LayerId> layers;
        for (int number = 0; number < 4'000; ++number)
            layers.insert({std::string(700, 'n') + std::to_string(number) + ".usda"});
        for (const LayerId& layer : layers) peer.docs[layer];
        peer.connect();
        for (const LayerId& layer : layers) peer.session.openLayer(layer);
        std::size_t most = 0;
        for (std::size_t asked = 1; asked > 0; most = std::max(most, asked)) {
            peer.advance();
            asked = 0;
            for (; const auto open = peer.takeControl<OpenLayer>(); ++asked)
                peer.sendSnapshot(*open);
        }
        EXPECT_EQ(most, 1'000u) << "not all at once";
        EXPECT_TRUE(std::ranges::all_of(
            layers, [&](const LayerId& layer) { return peer.session.isJoined(layer); }));
        peer.session.disconnected({ErrorCode::NotConnected, "cut"});
        const Hello hello = peer.connect();
        EXPECT_TRUE(checkClientControl(encodeControl(hello)));
        std::set<LayerId> told(hello.open->begin(), hello.open->end());
        peer.advance();
        while (!peer.sent.empty()) {
            const auto frame = peer.take<ControlFrame>();
            EXPECT_TRUE(checkClientControl(frame->json));
            const auto message = decodeControl(frame->json).value();
            if (const auto* kept = std::get_if<KeepLayers>(&message))
                told.insert(kept->layers.begin(), kept->layers.end());
            if (const auto* open = std::get_if<OpenLayer>(&message)) {
                told.insert(open->layer);
                peer.sendSnapshot(*open);
                peer.advance();
            }
            EXPECT_EQ(std::holds_alternative<KeepLayers>(message), isKnown);
        }
        EXPECT_TRUE(told == layers) << told.size();
    }
}

// ---- sending

// This is found without building a frame: more than 2 GiB cannot be built.
TEST_F(SessionTest, SE11ATooLargeTransactionComesBackWithTheLimit) {
    joinShot();
    // The edits share their bytes: 3 GiB cost nothing here.
    const FieldValue big(stringValue(std::string(2'000'000, 'x')));
    std::vector<AuthoredEdit> edits;
    for (int i = 0; i < 1'600; ++i)
        edits.push_back(authored("/A", SetField{"note" + std::to_string(i), {}, big, {}}));
    peer.author(std::move(edits));
    peer.author({authored("/B", createPrim())});
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].work.reason.code, ErrorCode::TransactionTooLarge);
    EXPECT_NE(lost[0].work.reason.message.find("1024 MiB at once"), std::string::npos);
    EXPECT_EQ(lost[0].work.edits.size(), 1'600u);
    EXPECT_EQ(peer.takeTransaction().edits.size(), 1u) << "later work is sent";
}

TEST_F(SessionTest, FR8ATransactionThatNoFrameCanHoldIsSentInPartsAndIsOneCommit) {
    Session::Options options;
    options.wholeBytes = 100'000;
    options.partBytes = 50'000;
    SessionPeer peer(options);
    peer.commit(peer.foreign({edit("/A", createPrim())}));
    peer.connectAndJoin();
    const FieldValue big(stringValue(std::string(2'000, 'x')));
    std::vector<AuthoredEdit> edits;
    for (int i = 0; i < 500; ++i)
        edits.push_back(authored("/A", SetField{"note" + std::to_string(i), {}, big, {}}));
    peer.author(edits);
    peer.author({authored("/B", createPrim())});
    peer.takesParts = false;
    peer.advance();
    EXPECT_TRUE(peer.sent.empty()) << "the connection accepts no more";
    peer.takesParts = true;
    peer.advance(3);
    ASSERT_FALSE(peer.sent.empty());
    EXPECT_LT(peer.sent.size(), 10u) << "only for as long as the frame has time";
    peer.advance();
    Transaction whole = peer.takeParts();
    EXPECT_EQ(whole.edits.size(), 500u);
    EXPECT_EQ(peer.takeTransaction().edits.size(), 1u) << "behind it";
    peer.commitAndTell(whole);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.session.pendingTransactions(), 1u);
}

TEST_F(SessionTest, FR8PartsAreSentAgainOnANewConnection) {
    Session::Options options;
    options.wholeBytes = 100'000;
    options.partBytes = 50'000;
    SessionPeer peer(options);
    peer.commit(peer.foreign({edit("/A", createPrim())}));
    peer.connectAndJoin();
    const FieldValue big(stringValue(std::string(2'000, 'x')));
    std::vector<AuthoredEdit> edits;
    for (int i = 0; i < 500; ++i)
        edits.push_back(authored("/A", SetField{"note" + std::to_string(i), {}, big, {}}));
    peer.author(edits);
    peer.advance(3);
    ASSERT_FALSE(peer.sent.empty());
    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    peer.commit(peer.foreign({edit("/A", moveTo("/", "C"))}));
    peer.connect();
    peer.advance();
    const Transaction whole = peer.takeParts();
    ASSERT_EQ(whole.edits.size(), 500u);
    EXPECT_EQ(whole.edits[0].address.path, "/C");
    EXPECT_EQ(whole.edits[499].address.path, "/C");
}

TEST_F(SessionTest, FR8ACommitInPartsIsShownWithItsLastPart) {
    joinShot();
    std::vector<Edit> edits;
    for (int i = 0; i < 50; ++i) edits.push_back(edit("/B" + std::to_string(i), createPrim()));
    const Commit commit = peer.commit(peer.foreign(edits));
    std::vector<Bytes> parts;
    for (PartsAt at; !at.isEnd;) parts.push_back(encodePart(commit, at, 500));
    ASSERT_GT(parts.size(), 3u);
    for (const Bytes& part : parts) {
        EXPECT_FALSE(peer.editor.at(kShot).has("/B0"));
        peer.session.received(peer.reader->read(part));
        peer.advance();
    }
    EXPECT_TRUE(peer.agrees());
    EXPECT_TRUE(peer.editor.at(kShot).has("/B49"));
}

// ---- values that are written again before they were sent

TEST_F(SessionTest, SE15AnHourOfWritesWithoutAConnectionIsOneTransaction) {
    joinShot();
    peer.author({authored("/A.x", SetField{"default", {}, doubleValue(-1), {}})});
    peer.advance();
    peer.sent.clear();
    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    constexpr int kFrames = seedsOf(10'000);
    for (int frame = 0; frame < kFrames; ++frame) {
        peer.author({authored("/A.x", SetField{"default", {}, doubleValue(frame), {}})});
        peer.author({authored("/A", setText("comment", std::to_string(frame)))});
    }
    EXPECT_EQ(peer.session.pendingTransactions(), 3u) << "one that was sent, and the last values";
    EXPECT_EQ(peer.session.writtenAgain(), 2u * (kFrames - 1));
    peer.connect();
    peer.advance();
    const Transaction sent = peer.takeTransaction();
    EXPECT_EQ(sent.id.sequence, 1u) << "the server may have that one already";
    const Transaction value = peer.takeTransaction(), comment = peer.takeTransaction();
    EXPECT_EQ(std::get<SetField>(value.edits[0].action).value,
              FieldValue(doubleValue(kFrames - 1)));
    for (const Transaction& one : {sent, value, comment}) peer.commitAndTell(one);
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), std::to_string(kFrames - 1));
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
}

TEST_F(SessionTest, SE15TheOrderOfDependentWorkStays) {
    joinShot();
    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    const auto x = [](double value) {
        return authored("/A.x", SetField{"default", {}, doubleValue(value), {}});
    };
    const auto comment = [](const char* text) { return authored("/A", setText("comment", text)); };
    peer.author({x(1)});
    peer.author({x(2), comment("a")});
    peer.author({x(3)});  // the previous transaction writes it, too
    EXPECT_EQ(peer.session.pendingTransactions(), 3u);
    peer.author({x(4), comment("b")});
    EXPECT_EQ(peer.session.pendingTransactions(), 4u) << "between them x was written";
    peer.author({x(5), comment("c")});
    EXPECT_EQ(peer.session.pendingTransactions(), 4u);
    peer.author({authored("/A", moveTo("/", "C"))});
    peer.author({authored("/C.x", SetField{"default", {}, doubleValue(6), {}})});
    EXPECT_EQ(peer.session.pendingTransactions(), 6u);
    peer.author({authored("/C.x", EraseField{"default", {}})});
    peer.author({authored("/C.x", SetField{"default", {}, doubleValue(7), {}})});
    EXPECT_EQ(peer.session.pendingTransactions(), 8u);
    peer.session.beginGesture();
    peer.author({authored("/C.x", SetField{"default", {}, doubleValue(8), {}})});
    peer.session.endGesture();
    peer.author({authored("/C.x", SetField{"default", {}, doubleValue(9), {}})});
    EXPECT_EQ(peer.session.pendingTransactions(), 10u)
        << "a transaction that ends a gesture is not replaced";
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, SE15ARefusalLosesNoMoreThanWithoutReplacement) {
    joinShot();
    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    peer.author({authored("/A", setText("comment", "one"))});
    peer.author({authored("/A.x", SetField{"default", {}, doubleValue(1), {}})});
    peer.author({authored("/A", setText("comment", "two"))});
    peer.connect();
    peer.advance();
    const Transaction comment = peer.takeTransaction(), value = peer.takeTransaction();
    peer.deliver(Frame(RefusalFrame{comment.id.sequence, 0, {ErrorCode::Locked, "locked"}}));
    peer.commitAndTell(value);
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    ASSERT_EQ(lost[0].work.edits.size(), 1u);
    EXPECT_EQ(lost[0].work.edits[0].action, setText("comment", "two"));
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, SE15WorkThatIsSentUnderItsOwnNumberKeepsIt) {
    joinShot();
    peer.session.disconnected({ErrorCode::NotConnected, "cut"});
    for (const std::uint64_t number : {11, 12}) {
        peer.session.setNextSequence(number);
        peer.author({authored("/A", setText("comment", std::to_string(number)))});
    }
    EXPECT_EQ(peer.session.pendingTransactions(), 2u);
}

// ---- joining

TEST_F(SessionTest, JoiningShowsTheLayerAndReportsProgress) {
    peer.commit(peer.foreign({edit("/A", createPrim())}));
    peer.connect();
    peer.session.openLayer(kShot);
    peer.advance();
    EXPECT_FALSE(peer.session.isJoined(kShot));
    EXPECT_EQ(peer.session.view(kShot), nullptr);
    answerOpenLayer();
    EXPECT_TRUE(peer.session.isJoined(kShot));
    EXPECT_TRUE(peer.editor.at(kShot).has("/A"));
    EXPECT_EQ(peer.eventsOf<event::Joined>().size(), 1u);
    ASSERT_FALSE(peer.eventsOf<event::Joining>().empty());
    EXPECT_EQ(peer.eventsOf<event::Joining>().back().progress.specsTotal, 2u);
}

TEST_F(SessionTest, CommitsThatOvertakeASnapshotAreApplied) {
    peer.connect();
    peer.session.openLayer(kShot);
    peer.advance();
    const auto open = peer.takeControl<OpenLayer>();
    const LayerDoc old = peer.docs.at(kShot);
    peer.commitAndTell(peer.foreign({edit("/A", createPrim())}));
    peer.advance();
    EXPECT_FALSE(peer.session.isJoined(kShot));
    peer.deliver(LayerOpened{open->request, kShot, 0, 1});
    SnapshotEncoder encoder(old, open->request);
    while (const auto frame = encoder.next()) peer.deliver(Frame(*frame));
    peer.commitAndTell(peer.foreign({edit("/B", createPrim())}));
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_TRUE(peer.editor.at(kShot).has("/A"));
    EXPECT_TRUE(peer.editor.at(kShot).has("/B"));
}

TEST_F(SessionTest, AMissingLayerFailsToJoin) {
    peer.connect();
    peer.session.openLayer({"none.usda"});
    peer.advance();
    const auto open = peer.takeControl<OpenLayer>();
    peer.deliver(ErrorMessage{"layerNotFound", "no", false, open->request, {}});
    peer.advance();
    ASSERT_EQ(peer.eventsOf<event::JoinFailed>().size(), 1u);
    EXPECT_EQ(peer.eventsOf<event::JoinFailed>()[0].reason.code, ErrorCode::LayerNotFound);
}

// The error was received, but the connection is lost before it is read.
TEST_F(SessionTest, AFailedJoinThatWasNotReadIsRequestedAgain) {
    peer.connect();
    peer.session.openLayer(kShot);
    peer.advance();
    const auto open = peer.takeControl<OpenLayer>();
    peer.deliver(ErrorMessage{"storageFailed", "the disk is broken", false, open->request, {}});
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    EXPECT_TRUE(peer.eventsOf<event::JoinFailed>().empty());
    peer.connect();
    peer.advance();
    answerOpenLayer();
    EXPECT_TRUE(peer.session.isJoined(kShot));
}

TEST_F(SessionTest, AnotherConnectionRequestsTheLayersAgain) {
    peer.connect();
    peer.session.openLayer(kShot);
    peer.advance();
    peer.connect();
    EXPECT_TRUE(peer.eventsOf<event::JoinFailed>().empty());
    peer.advance();
    answerOpenLayer();
    EXPECT_TRUE(peer.session.isJoined(kShot));
}

TEST_F(SessionTest, AdvanceStopsWhenItsTimeIsOver) {
    joinShot();
    for (int count = 0; count < 5; ++count)
        peer.commitAndTell(peer.foreign({edit("/A", setText("comment", std::to_string(count)))}));
    EXPECT_FALSE(peer.advance(0));
    EXPECT_EQ(peer.session.revision(), 2u);
    EXPECT_TRUE(peer.agrees() || peer.session.revision() < peer.head());
    EXPECT_TRUE(peer.advance());
    EXPECT_EQ(peer.session.revision(), 6u);
    EXPECT_EQ(peer.text("/A", "comment"), "4");
}

TEST_F(SessionTest, AClosedLayerStaysUntilItsPendingWorkIsAnswered) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction mine = peer.takeTransaction();
    peer.session.closeLayer(kShot);
    peer.editor.erase(kShot);
    peer.advance();
    EXPECT_FALSE(peer.session.isJoined(kShot));
    EXPECT_FALSE(peer.takeControl<CloseLayer>());
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.takeControl<CloseLayer>());
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
}

TEST_F(SessionTest, AClosedLayerIsOpenedAgainFromMemory) {
    joinShot();
    authorComment("/A", "mine");
    peer.session.closeLayer(kShot);
    peer.advance();
    peer.session.openLayer(kShot);
    peer.advance();
    EXPECT_TRUE(peer.session.isJoined(kShot));
    EXPECT_EQ(peer.text("/A", "comment"), "mine");
}

// ---- M7

TEST_F(SessionTest, M7AForeignEditIsShownAsItIs) {
    joinShot();
    const std::size_t before = peer.shown;
    peer.commitAndTell(peer.foreign({edit("/A", setText("comment", "theirs"))}));
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
    EXPECT_EQ(peer.shown, before + 1);
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M7OnesOwnEditIsNotShownAgain) {
    joinShot();
    const std::size_t before = peer.shown;
    authorComment("/A", "mine");
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_EQ(peer.shown, before);
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M7AForeignEditOfARegisterWithAPendingWriteIsNotShown) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction mine = peer.takeTransaction();
    peer.commitAndTell(peer.foreign(
        {edit("/A", setText("comment", "theirs")), edit("/A", setText("kind", "shown"))}));
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "mine");
    EXPECT_EQ(peer.text("/A", "kind"), "shown");
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "mine");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M7WhenThePendingWriteIsRefusedTheConfirmedValueIsShown) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction mine = peer.takeTransaction();
    peer.commitAndTell(peer.foreign({edit("/A", setText("comment", "theirs"))}));
    peer.deliver(RefusalFrame{mine.id.sequence, 0, {ErrorCode::Locked, "locked"}});
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M7AForeignRenameCarriesAPendingEditAlong) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction mine = peer.takeTransaction();
    peer.commitAndTell(peer.foreign({edit("/A", moveTo("/", "B"))}));
    peer.advance();
    EXPECT_EQ(peer.text("/B", "comment"), "mine");
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
}

// ---- M3: addresses

TEST_F(SessionTest, M3SpecsOfPendingWorkAreAddressedByTheirCreation) {
    joinShot();
    peer.author({authored("/B", createPrim())});
    peer.advance();
    peer.author({authored("/B.y", createAttribute()), authored("/B", moveTo("/A", "C"))});
    peer.author({authored("/A/C.y", setText("comment", "deep"))});
    peer.advance();
    const Transaction first = peer.takeTransaction();
    const Transaction second = peer.takeTransaction();
    const Transaction third = peer.takeTransaction();
    EXPECT_EQ(second.edits[0].address, (Address{".y", Creation{first.id.sequence, 0}}));
    EXPECT_EQ(second.edits[1].address, (Address{"", Creation{first.id.sequence, 0}}));
    EXPECT_EQ(std::get<MoveSpec>(second.edits[1].action).parent, (Address{"/A", {}}));
    EXPECT_EQ(third.edits[0].address, (Address{"", Creation{second.id.sequence, 0}}));
    for (const Transaction& mine : {first, second, third}) peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.text("/A/C.y", "comment"), "deep");
}

// The same happens when others create a spec of that name at the same time, and delete it again.
TEST_F(SessionTest, M3EditsAfterACreationApplyToTheSpecThatItCreates) {
    joinShot();
    peer.author({authored("/A.x", createAttribute()), authored("/A.x", setText("kind", "one"))});
    peer.author({authored("/A.x", setText("comment", "two"))});
    peer.advance();
    const Transaction first = peer.takeTransaction(), second = peer.takeTransaction();
    for (const Revision revision :
         {peer.commit(peer.foreign({edit("/A.x", DeleteSpec{})})).revision,
          peer.commit(first).revision, peer.commit(second).revision})
        peer.deliverCommit(revision);
    peer.advance();
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
    EXPECT_EQ(peer.text("/A.x", "kind"), "one");
    EXPECT_EQ(peer.text("/A.x", "comment"), "two");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M3SpecsThatPendingWorkHasMovedAreAddressedWhereTheyWere) {
    joinShot();
    peer.author({authored("/A", moveTo("/", "B")), authored("/B.x", setText("comment", "one"))});
    peer.author({authored("/B.x", setText("kind", "two")), authored("/A", createPrim())});
    peer.author({authored("/B", moveTo("/A", "B")), authored("/A/B.x", setText("doc", "three"))});
    peer.advance();
    const Transaction first = peer.takeTransaction();
    const Transaction second = peer.takeTransaction();
    const Transaction third = peer.takeTransaction();
    EXPECT_EQ(first.edits[1].address.path, "/A.x");
    EXPECT_EQ(second.edits[0].address.path, "/A.x");
    EXPECT_EQ(third.edits[0].address.path, "/A");
    EXPECT_EQ(third.edits[1].address.path, "/A.x");
    EXPECT_EQ(std::get<MoveSpec>(third.edits[0].action).parent.creation,
              (Creation{second.id.sequence, 1}));
    for (const Transaction& mine : {first, second, third}) peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.text("/A/B.x", "doc"), "three");
}

TEST_F(SessionTest, M3ChildrenOfACreatedVariantAreAddressedByIt) {
    joinShot();
    peer.author({authored("/A{v=}", CreateSpec{SpecKind::VariantSet}),
                 authored("/A{v=one}", CreateSpec{SpecKind::Variant}),
                 authored("/A{v=one}B", createPrim()),
                 authored("/A{v=one}B.y", createAttribute())});
    peer.advance();
    const Transaction mine = peer.takeTransaction();
    EXPECT_EQ(mine.edits[1].address.path, "{v=one}");
    EXPECT_EQ(mine.edits[2].address.path, "B");
    EXPECT_EQ(mine.edits[3].address.path, ".y");
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

// ---- M4, M6, M12

TEST_F(SessionTest, M4WorkOnADeletedSpecComesBack) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction mine = peer.takeTransaction();
    peer.commit(peer.foreign({edit("/A", DeleteSpec{})}));
    peer.commit(mine);
    peer.deliverCommit(2);
    peer.deliverCommit(3);
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_FALSE(lost[0].work.refused);
    EXPECT_EQ(lost[0].work.reason.code, ErrorCode::SpecDeleted);
    ASSERT_EQ(lost[0].work.edits.size(), 1u);
    EXPECT_EQ(lost[0].work.edits[0].path, "/A");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M15AMoveOfASpecAndALaterOneOfAPlaceAreTwo) {
    joinShot();
    peer.author({authored("/A", moveTo("/", "B"))});  // the object is still at /A
    peer.advance();
    (void)peer.takeTransaction();
    const auto place = [](const char* from, const char* to) {
        return authored(from, MoveSpec{{"/", {}}, to, true});
    };
    peer.author({authored("/B", moveTo("/", "Third")), place("/B", "Third"), place("/A", "B"),
                 authored("/Third", moveTo("/", "A")), place("/Third", "A")});
    peer.advance();
    const Transaction swap = peer.takeTransaction();
    ASSERT_EQ(swap.edits.size(), 5u);
    EXPECT_EQ(swap.edits[1].address, (Address{"/B", {}}));
    EXPECT_EQ(swap.edits[2].address, (Address{"/A", {}}));
    EXPECT_EQ(swap.edits[4].address, (Address{"/B", {}}));
}

// The spec comes from elsewhere than the object whose place is moved to the same path.
TEST_F(SessionTest, M15AChildOfAMovedSpecIsCreatedBelowIt) {
    joinShot();
    const auto place = [](const char* from, const char* parent, const char* name) {
        return authored(from, MoveSpec{{parent, {}}, name, true});
    };
    peer.author({authored("/A", moveTo("/", "C")), authored("/C/K", createPrim())});
    peer.author({authored("/C/K", moveTo("/", "E")), place("/C/K", "/", "E")});
    peer.author({authored("/C", moveTo("/", "Third")), place("/A", "/", "Third")});
    peer.author(
        {authored("/Third/K", createPrim()), authored("/Third/K", setText("comment", "mine"))});
    peer.advance();
    for (int count = 0; count < 4; ++count) peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_EQ(peer.text("/Third/K", "comment"), "mine");
    EXPECT_TRUE(peer.agrees());
}

// The server drops what is below a spec that is not created, also if others have moved its place.
TEST_F(SessionTest, M15ACreatedChildIsLostWithItsParent) {
    joinShot();
    peer.session.disconnected({ErrorCode::NotConnected, "gone"});
    peer.author({authored("/A/N", createPrim()), authored("/A/N/D", createPrim())});
    peer.commit(peer.foreign({edit("/A/N/D", MoveSpec{{"/", {}}, "C", true})}));
    peer.commit(peer.foreign({edit("/A", DeleteSpec{})}));
    (void)peer.connect();
    peer.deliverCommit(peer.head() - 1);
    peer.deliverCommit(peer.head());
    peer.advance();
    EXPECT_FALSE(peer.editor.at(kShot).has("/C"));
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_FALSE(peer.editor.at(kShot).has("/C"));
    EXPECT_TRUE(peer.agrees());
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].work.edits.size(), 2u);
}

TEST_F(SessionTest, M17WorkThatIsDeletedUnseenIsReported) {
    joinShot();
    Transaction deletes = peer.foreign({edit("/B", DeleteSpec{})});
    deletes.base = deletes.seen = peer.head();
    peer.author({authored("/A", setText("comment", "stays")), authored("/A/C", createPrim()),
                 authored("/A/C", setText("comment", "mine"))});
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    authorComment("/A/C", "again");
    const Transaction last = peer.takeTransaction();
    peer.commitAndTell(last);
    peer.advance();
    peer.commitAndTell(peer.foreign({edit("/A/C", moveTo("/", "B"))}));
    deletes.base = peer.head();  // the address is renewed when it is sent, and `seen` stays
    peer.commitAndTell(deletes);
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].work.reason.code, ErrorCode::DeletedUnseen);
    EXPECT_FALSE(lost[0].work.refused);
    EXPECT_EQ(lost[0].work.sequence, last.id.sequence);
    ASSERT_EQ(lost[0].work.edits.size(), 3u);
    EXPECT_EQ(lost[0].work.edits[0].path, "/A/C");
    EXPECT_EQ(lost[0].work.edits[0].action, EditAction(createPrim()));
    EXPECT_EQ(lost[0].work.edits[1].action, EditAction(setText("comment", "mine")));
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M17ADeleteThatHasSeenTheWorkIsNotReported) {
    joinShot();
    authorComment("/A", "mine");
    peer.commitAndTell(peer.takeTransaction());
    peer.commitAndTell(peer.foreign({edit("/A", DeleteSpec{})}));
    peer.advance();
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
}

TEST_F(SessionTest, M17ADeleteSaysWhatItsAuthorHadSeenAlsoIfItIsSentLater) {
    joinShot();
    const Revision seen = peer.head();
    peer.session.disconnected({ErrorCode::NotConnected, "gone"});
    peer.author({authored("/A", DeleteSpec{})});
    peer.commit(peer.foreign({edit("/A", setText("comment", "theirs"))}));
    (void)peer.connect();
    peer.advance();
    const Transaction deletes = peer.takeTransaction();
    EXPECT_EQ(deletes.seen, seen);
    EXPECT_GT(deletes.base, seen);
}

TEST_F(SessionTest, M6ARefusedTransactionIsUndoneAndLaterOnesStay) {
    joinShot();
    peer.author({authored("/B", createPrim())});
    peer.author({authored("/B.y", createAttribute()), authored("/A", setText("comment", "kept"))});
    peer.advance();
    const Transaction first = peer.takeTransaction();
    const Transaction second = peer.takeTransaction();
    peer.deliver(RefusalFrame{first.id.sequence, 0, {ErrorCode::Locked, "locked"}});
    peer.advance();
    EXPECT_FALSE(peer.editor.at(kShot).has("/B"));
    EXPECT_EQ(peer.text("/A", "comment"), "kept");
    ASSERT_EQ(peer.eventsOf<event::Lost>().size(), 1u);
    EXPECT_TRUE(peer.eventsOf<event::Lost>()[0].work.refused);

    peer.commitAndTell(second);
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 2u);
    ASSERT_EQ(lost[1].work.edits.size(), 1u);
    EXPECT_EQ(lost[1].work.edits[0].path, "/B.y");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M12UnsupportedEditsComeBackAtOnceAndTheRestStays) {
    joinShot();
    const std::size_t before = peer.shown;
    peer.author({authored("/", SetField{"timeCodesPerSecond", {}, doubleValue(0), {}}),
                 authored("/A", setText("comment", "kept"))});
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].work.reason.code, ErrorCode::ForbiddenValue);
    ASSERT_EQ(lost[0].work.edits.size(), 1u);
    EXPECT_EQ(peer.shown, before + 1);  // the field as it is in the model
    EXPECT_EQ(peer.takeTransaction().edits.size(), 1u);
}

TEST_F(SessionTest, M12AnEditThatCouldNotBeMadeIsRepairedAtTheNewPlaceOfItsSpec) {
    joinShot();
    peer.author({authored("/A", SetField{"primChildren", {}, stringValue("no field"), {}}),
                 authored("/A", moveTo("/", "B")), authored("/B", DeleteSpec{})});
    peer.advance();
    EXPECT_EQ(peer.eventsOf<event::Lost>().size(), 1u);
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M12OfflineWorkBeyondTheBoundComesBack) {
    Session::Options options;
    options.maxUnsentTransactions = 2;
    SessionPeer small(options);
    small.connectAndJoin();
    small.session.disconnected({ErrorCode::NotConnected, "away"});
    small.author({authored("/A", createPrim())});
    small.author({authored("/B", createPrim())});
    small.author({authored("/C", createPrim())});
    small.advance();
    EXPECT_EQ(small.session.pendingTransactions(), 2u);
    ASSERT_EQ(small.eventsOf<event::Lost>().size(), 1u);
    EXPECT_FALSE(small.editor.at(kShot).has("/C"));
    EXPECT_TRUE(small.agrees());
}

TEST_F(SessionTest, WorkOnALayerThatIsNotOpenComesBack) {
    joinShot();
    peer.session.author({authored("/A", createPrim(), kLook)});
    peer.advance();
    ASSERT_EQ(peer.eventsOf<event::Lost>().size(), 1u);
    EXPECT_EQ(peer.eventsOf<event::Lost>()[0].work.reason.code, ErrorCode::LayerNotOpen);
}

TEST_F(SessionTest, StaleWorkGetsNewAddresses) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction old = peer.takeTransaction();
    peer.commitAndTell(peer.foreign({edit("/A", moveTo("/", "B"))}));
    peer.deliver(RefusalFrame{old.id.sequence, 0, {ErrorCode::StaleBase, "too old"}});
    peer.advance();
    const Transaction again = peer.takeTransaction();
    EXPECT_EQ(again.id.sequence, old.id.sequence);
    EXPECT_EQ(again.base, 2u);
    EXPECT_EQ(again.edits[0].address.path, "/B");
    peer.commitAndTell(again);
    peer.advance();
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
    EXPECT_TRUE(peer.agrees());
}

// ---- SE21: refusals for a reason that passes

TEST_F(SessionTest, SE21WorkRefusedForAReasonThatPassesIsSentAgainInOrder) {
    joinShot();
    peer.author({authored("/B", createPrim())});
    peer.author({authored("/B.y", createAttribute())});
    peer.advance();
    const Transaction first = peer.takeTransaction(), second = peer.takeTransaction();
    const Error full{ErrorCode::StorageFull, "the disk is full"};
    peer.deliver(RefusalFrame{first.id.sequence, 0, full});
    peer.advance();
    authorComment("/A", "later");
    peer.nowMs += 10'000;
    peer.advance();
    EXPECT_TRUE(peer.sent.empty()) << "the second one is not answered yet";
    peer.deliver(RefusalFrame{second.id.sequence, 0, full});
    peer.advance();
    EXPECT_EQ(peer.takeTransaction().id, first.id);
    EXPECT_TRUE(peer.sent.empty()) << "one is enough to find out whether there is space";

    peer.deliver(RefusalFrame{first.id.sequence, 0, full});
    peer.advance();
    EXPECT_TRUE(peer.sent.empty()) << "it is not sent again at once";
    peer.nowMs += 10'000;
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    EXPECT_EQ(peer.docs.at(kShot).has("/B.y"), true);
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_TRUE(peer.agrees());
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
    ASSERT_EQ(peer.eventsOf<event::ServerError>().size(), 1u) << "the editor is notified once";
    EXPECT_EQ(peer.eventsOf<event::ServerError>()[0].message.code, "storageFull");
}

TEST_F(SessionTest, SE21ANewConnectionSendsAtOnceWhatWasRefusedForAReasonThatPasses) {
    joinShot();
    authorComment("/A", "mine");
    const Transaction own = peer.takeTransaction();
    peer.deliver(RefusalFrame{own.id.sequence, 0, {ErrorCode::StorageFailed, "failed"}});
    peer.advance();
    authorComment("/A", "newer");  // SE15: it was never accepted
    EXPECT_EQ(peer.session.pendingTransactions(), 1u);
    EXPECT_EQ(peer.text("/A", "comment"), "newer");
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.connect();
    peer.advance();
    const Transaction again = peer.takeTransaction();
    EXPECT_EQ(again.id, own.id);
    peer.commitAndTell(again);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.text("/A", "comment"), "newer");
}

// ---- M9: connections

TEST_F(SessionTest, M9PendingWorkIsSentOnceWhenTheSessionHasCaughtUp) {
    joinShot();
    peer.author({authored("/B", createPrim())});
    peer.author({authored("/B.y", createAttribute())});
    peer.advance();
    const Transaction first = peer.takeTransaction();
    const Transaction second = peer.takeTransaction();
    peer.commit(first);  // its acknowledgement is lost
    peer.commit(peer.foreign({edit("/B", moveTo("/A", "C"))}));
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.advance();
    authorComment("/A", "offline");

    const Hello hello = peer.connect();
    ASSERT_TRUE(hello.resume);
    EXPECT_EQ(hello.resume->revision, 1u);
    EXPECT_EQ(hello.resume->hash, peer.hashAt(1));
    peer.advance();
    const Transaction again = peer.takeTransaction();
    EXPECT_EQ(again.id.sequence, second.id.sequence);
    EXPECT_EQ(again.base, 3u);
    EXPECT_EQ(again.edits[0].address, (Address{"/A/C.y", {}}));
    const Transaction offline = peer.takeTransaction();
    EXPECT_FALSE(peer.take<SubmitFrame>());
    peer.commitAndTell(again);
    peer.commitAndTell(offline);
    peer.advance();
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M9AnEditThatIsLostMeanwhileKeepsThePlaceOfTheOthers) {
    joinShot();
    peer.author({authored("/A", setText("comment", "in vain")), authored("/B", createPrim())});
    peer.author({authored("/B.y", createAttribute())});
    peer.advance();
    peer.commit(peer.foreign({edit("/A", DeleteSpec{})}));
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.connect();
    peer.advance();
    const Transaction first = peer.takeTransaction();
    const Transaction second = peer.takeTransaction();
    EXPECT_EQ(first.edits.size(), 2u);
    EXPECT_EQ(second.edits[0].address, (Address{".y", Creation{first.id.sequence, 1}}));
    peer.commitAndTell(first);
    peer.commitAndTell(second);
    peer.advance();
    ASSERT_EQ(peer.eventsOf<event::Lost>().size(), 1u);
    EXPECT_EQ(peer.eventsOf<event::Lost>()[0].work.edits.size(), 1u);
    EXPECT_TRUE(peer.agrees());
}

// Commits everything that the session sends, until it sends nothing more. Returns the number of
// calls that this took.
int commitAll(SessionPeer& peer, double budgetMs) {
    int calls = 0;
    for (; peer.session.pendingTransactions() > 0 && calls < 100'000; ++calls) {
        peer.advance(budgetMs);
        while (const auto frame = peer.take<SubmitFrame>()) peer.commitAndTell(frame->transaction);
    }
    peer.advance();
    return calls;
}

TEST_F(SessionTest, PendingWorkIsPredictedAndSentWithinTheBudget) {
    Session::Options options;
    options.leastAtOnce = 1;
    SessionPeer away(options);
    away.commit(away.foreign({edit("/A", createPrim())}));
    away.connectAndJoin();
    away.session.disconnected({ErrorCode::NotConnected, "away"});
    away.advance();
    constexpr int kFrames = 300;
    for (int i = 0; i < kFrames; ++i) {
        if (i % 10 == 3)
            away.author({authored("/P" + std::to_string(i), createPrim())});
        else if (i % 10 == 7)
            away.author(
                {authored("/P" + std::to_string(i - 4), moveTo("/", "Q" + std::to_string(i)))});
        else
            away.author(
                {authored("/A", setText(i % 2 ? "comment" : "documentation", std::to_string(i)))});
    }
    // Somebody else renames the prim of all these edits, and continues.
    away.commit(away.foreign({edit("/A", moveTo("/", "B"))}));
    away.commit(away.foreign({edit("/B", setText("comment", "theirs"))}));
    away.connect();

    // The clock advances by a millisecond at each reading. No call reads it without end.
    double longest = 0;
    int calls = 0, renamedAfter = 0;
    for (; away.session.pendingTransactions() > 0 && calls < 10'000; ++calls) {
        const double before = away.clockMs;
        away.advance(4);
        longest = std::max(longest, away.clockMs - before);
        if (away.editor.at(kShot).has("/B") && renamedAfter == 0) renamedAfter = calls;
        EXPECT_TRUE(*away.session.view(kShot) == away.editor.at(kShot));
        while (const auto frame = away.take<SubmitFrame>()) away.commitAndTell(frame->transaction);
    }
    away.advance();
    EXPECT_LE(longest, 8);
    EXPECT_GT(renamedAfter, 0);  // not in the first call
    EXPECT_TRUE(away.eventsOf<event::Lost>().empty());
    EXPECT_EQ(away.text("/B", "comment"), "299");
    EXPECT_TRUE(away.agrees());
}

TEST_F(SessionTest, EditsWhileTheViewIsBehindApplyToTheShownSpecs) {
    Session::Options options;
    options.leastAtOnce = 1;
    SessionPeer away(options);
    away.commit(away.foreign({edit("/A", createPrim())}));
    away.connectAndJoin();
    away.session.disconnected({ErrorCode::NotConnected, "away"});
    away.advance();
    for (int i = 0; i < 100; ++i)
        away.author({authored("/A", setText("note" + std::to_string(i), "mine"))});
    away.commit(away.foreign({edit("/A", moveTo("/", "B"))}));
    away.commit(away.foreign({edit("/A", createPrim())}));  // another prim of that name
    away.connect();
    away.advance(0);
    away.advance(0);
    away.advance(0);
    ASSERT_EQ(away.session.revision(), away.head());
    ASSERT_TRUE(away.editor.at(kShot).has("/A"));
    ASSERT_FALSE(away.editor.at(kShot).has("/B"));  // not yet
    away.author({authored("/A", setText("documentation", "for what is B now"))});
    commitAll(away, 4);
    EXPECT_TRUE(away.eventsOf<event::Lost>().empty());
    EXPECT_EQ(away.text("/B", "documentation"), "for what is B now");
    EXPECT_EQ(away.text("/A", "documentation"), "-");
    EXPECT_TRUE(away.agrees());
}

TEST_F(SessionTest, CommitsOfOthersCannotKeepTheViewFromFollowing) {
    Session::Options options;
    options.leastAtOnce = 1;
    SessionPeer away(options);
    away.commit(away.foreign({edit("/A", createPrim())}));
    away.connectAndJoin();
    away.session.disconnected({ErrorCode::NotConnected, "away"});
    away.advance();
    for (int i = 0; i < 200; ++i)
        away.author({authored(
            "/A",
            SetField{"customData", DictionaryKey{{std::to_string(i)}}, stringValue("mine"), {}})});
    away.connect();
    // The server commits none of these edits, but writes of others to the same field.
    bool seen = false;
    for (int i = 0; i < 400 && !seen; ++i) {
        away.commitAndTell(away.foreign({edit(
            "/A",
            SetField{
                "customData", DictionaryKey{{"theirs"}}, stringValue(std::to_string(i)), {}})}));
        away.advance(4);
        const auto* data = away.editor.at(kShot).field("/A", "customData");
        seen = data && data->as<Dictionary>() && data->as<Dictionary>()->entries.contains("theirs");
    }
    EXPECT_TRUE(seen);
    commitAll(away, 4);
    EXPECT_TRUE(away.agrees());
}

TEST_F(SessionTest, M12DroppedEditsOfAMissedCommitAreReadFromTheLog) {
    joinShot();
    peer.author({authored("/A", setText("comment", "in vain")), authored("/B", createPrim())});
    peer.advance();
    const Transaction own = peer.takeTransaction();
    peer.commit(peer.foreign({edit("/A", DeleteSpec{})}));
    const Revision revision = peer.commit(own).revision;
    for (int times = 0; times < 2;
         ++times) {  // the connection breaks once more before the log arrives
        peer.session.disconnected({ErrorCode::NotConnected, "away"});
        peer.session.connected();
        peer.deliver(peer.welcomeMessage(false));
        peer.advance();
        peer.sendSnapshot(*peer.takeControl<OpenLayer>());
        peer.advance();
        if (times == 0) peer.deliver(AlreadyCommitted{own.id.sequence, revision});
        peer.advance();
        EXPECT_EQ(peer.session.pendingTransactions(), 1u);
    }
    const auto request = peer.takeControl<RequestLog>();
    ASSERT_TRUE(request);
    EXPECT_EQ(request->from, revision);
    EXPECT_EQ(request->to, revision);
    peer.deliver(LogBegin{request->request});
    peer.deliverCommit(revision);
    peer.deliver(LogEnd{request->request});
    peer.advance();
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    ASSERT_EQ(lost[0].work.edits.size(), 1u);
    EXPECT_EQ(lost[0].work.edits[0].path, "/A");
    EXPECT_TRUE(peer.agrees());
    // Its author is notified of the commit, too.
    const auto committed = peer.eventsOf<event::Committed>();
    ASSERT_EQ(std::ranges::count(committed, true, &event::Committed::missed), 1);
    EXPECT_EQ(std::ranges::find(committed, true, &event::Committed::missed)->commit.id, own.id);
}

// Nobody knows whether the sent work is committed: it is not sent again, and it is reported as
// lost.
TEST_F(SessionTest, M14AForgottenClientGetsBackItsSentWork) {
    joinShot();
    peer.author({authored("/A", setText("comment", "sent"))});
    peer.advance();
    peer.commit(peer.takeTransaction());
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.author({authored("/A", setText("kind", "not sent"))});
    peer.sent.clear();
    peer.session.connected();
    ASSERT_TRUE(peer.takeControl<Hello>()->resume);
    peer.deliver(ErrorMessage{"clientForgotten", "away for long", false, {}, {}});
    peer.deliver(peer.welcomeMessage(false));
    peer.advance();
    const auto lost = peer.eventsOf<event::Lost>();
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].work.reason.code, ErrorCode::ClientForgotten);
    ASSERT_EQ(lost[0].work.edits.size(), 1u);
    EXPECT_EQ(lost[0].work.edits[0].action, EditAction(setText("comment", "sent")));
    EXPECT_EQ(peer.session.pendingTransactions(), 1u);
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    peer.advance();
    const Transaction own = peer.takeTransaction();
    ASSERT_EQ(own.edits.size(), 1u);
    EXPECT_EQ(own.edits[0].action, EditAction(setText("kind", "not sent")));
    peer.deliverCommit(peer.commit(own).revision);
    peer.advance();
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_TRUE(peer.agrees());
}

// When the layer is joined again, the prim exists already.
TEST_F(SessionTest, M13CarriedOverWorkIsMergedWithSpecsOfOthers) {
    joinShot();
    const auto specifier = [](std::uint8_t number) {
        return SetField{"specifier", {}, Value(ValueType::Specifier, Bytes{number}), {}};
    };
    const SetField def = specifier(0), over = specifier(1);
    peer.author({authored("/B", createPrim()), authored("/B", over)});
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.commit(peer.foreign({edit("/B", createPrim()), edit("/B", def)}));
    peer.sent.clear();
    peer.session.connected();
    peer.advance();
    peer.deliver(peer.welcomeMessage(false));
    peer.advance();
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    peer.advance();
    EXPECT_EQ(*peer.session.view(kShot)->field("/B", "specifier"), def.value);
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(*peer.session.view(kShot)->field("/B", "specifier"), def.value);
}

// The sent work may be committed: it is not lost, and the layer stays live.
TEST_F(SessionTest, ALayerThatTheServerCannotReadNowIsRequestedAgain) {
    joinShot();
    authorComment("/A", "mine");
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.sent.clear();
    peer.session.connected();
    peer.advance();
    peer.deliver(peer.welcomeMessage(false));
    peer.advance();
    const auto asked = peer.takeControl<OpenLayer>();
    peer.deliver(ErrorMessage{"storageFailed", "the store is closed", false, asked->request, {}});
    peer.advance();
    EXPECT_TRUE(peer.session.isJoined(kShot));
    EXPECT_EQ(peer.eventsOf<event::ServerError>().size(), 1u);
    EXPECT_FALSE(peer.takeControl<OpenLayer>());
    peer.nowMs += 2000;
    peer.advance();
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.text("/A", "comment"), "mine");
    EXPECT_TRUE(peer.eventsOf<event::JoinFailed>().empty());
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
}

TEST_F(SessionTest, ACommitOutOfOrderEndsTheConnection) {
    joinShot();
    Commit stray = peer.commit(peer.foreign({edit("/B", createPrim())}));
    stray.previous = sha256(asBytes("another history"));
    peer.deliver(CommitFrame{stray});
    peer.advance();
    const auto errors = peer.eventsOf<event::ServerError>();
    ASSERT_EQ(errors.size(), 1u);
    EXPECT_TRUE(errors[0].message.closing);
    EXPECT_FALSE(peer.session.isConnected());
}

TEST_F(SessionTest, AMalformedFrameEndsTheConnectionAfterTheFramesBeforeIt) {
    joinShot();
    peer.commit(peer.foreign({edit("/B", createPrim())}));
    peer.deliverCommit(peer.head());
    peer.session.received(peer.reader->read(Bytes(40, 7)));
    peer.advance();
    EXPECT_NE(peer.session.view(kShot)->kind("/B"), std::nullopt);
    const auto errors = peer.eventsOf<event::ServerError>();
    ASSERT_EQ(errors.size(), 1u);
    EXPECT_TRUE(errors[0].message.closing);
    EXPECT_EQ(errors[0].message.code, errorName(ErrorCode::FrameTooLarge));
    EXPECT_FALSE(peer.session.isConnected());
}

TEST_F(SessionTest, RequestsOnTheirWayAreSentAgain) {
    peer.connect();
    peer.session.openLayer(kShot);
    peer.advance();
    Commit stray = peer.commit(peer.foreign({edit("/A", createPrim())}));
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    stray.previous = sha256(asBytes("another history"));
    peer.deliver(CommitFrame{stray});
    peer.advance();
    EXPECT_FALSE(peer.session.isConnected());
    EXPECT_FALSE(peer.session.isJoined(kShot))
        << "the commit that the snapshot contains was not valid";
    peer.session.disconnected({ErrorCode::NotConnected, "it was closed"});
    EXPECT_TRUE(peer.connect().resume) << "the server compares the histories";
    peer.advance();
    const auto open = peer.takeControl<OpenLayer>();
    ASSERT_TRUE(open);
    peer.sendSnapshot(*open);
    peer.advance();
    EXPECT_TRUE(peer.session.isJoined(kShot));
    EXPECT_TRUE(peer.agrees());
    EXPECT_TRUE(peer.editor.at(kShot).has("/A"));
}

TEST_F(SessionTest, CP1ACheckpointIsAnsweredOrFailsWithTheReason) {
    const auto offline = peer.session.request(CreateCheckpoint{.name = "lunch"});
    peer.advance();
    EXPECT_EQ(peer.eventsOf<event::ServerError>().at(0).message.request, offline);
    joinShot();
    const auto first = peer.session.request(CreateCheckpoint{.name = "lunch"});
    EXPECT_EQ(*peer.takeControl<CreateCheckpoint>(), (CreateCheckpoint{first, "lunch"}));
    const Checkpoint lunch{"lunch", 1, {"ada"}, 7};
    peer.deliver(CheckpointCreated{first, lunch});
    peer.advance();
    const auto made = peer.eventsOf<event::CheckpointMade>();
    ASSERT_EQ(made.size(), 1u);
    EXPECT_EQ(made[0].answer, (CheckpointCreated{first, lunch}));
    const auto listing = peer.session.request(ListCheckpoints{});
    peer.deliver(Checkpoints{listing, {lunch}});
    const auto again = peer.session.request(CreateCheckpoint{.name = "lunch"});
    peer.deliver(ErrorMessage{"checkpointExists", "there is one", false, again, {}});
    const auto cut = peer.session.request(CreateCheckpoint{.name = "dinner"});
    peer.advance();
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.advance();
    EXPECT_EQ(peer.eventsOf<event::CheckpointsListed>().at(0).answer.checkpoints,
              std::vector{lunch});
    std::vector<std::uint64_t> failed;
    for (const auto& error : peer.eventsOf<event::ServerError>())
        failed.push_back(error.message.request.value_or(0));
    EXPECT_EQ(failed, (std::vector{again, cut})) << "each once";
}

TEST_F(SessionTest, AnOlderEpochIsIgnored) {
    joinShot();
    peer.epoch = 3;
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.connect();
    peer.advance();
    EXPECT_TRUE(peer.session.isConnected());
    peer.epoch = 2;
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.connect();
    peer.advance();
    EXPECT_FALSE(peer.session.isConnected());
}

// ---- M11

TEST_F(SessionTest, M11AGestureSendsPreviewsAndEndsInOneTransaction) {
    joinShot();
    peer.session.beginGesture();
    for (int step = 0; step < 5; ++step) {
        authorComment("/A", "step" + std::to_string(step));
        const auto preview = peer.take<PreviewFrame>();
        ASSERT_TRUE(preview);
        ASSERT_EQ(preview->edits.size(), 1u);  // the latest value has replaced the others
    }
    peer.advance();
    EXPECT_FALSE(peer.take<PreviewFrame>());
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    peer.session.endGesture();
    peer.advance();
    const Transaction mine = peer.takeTransaction();
    EXPECT_NE(mine.gesture, 0u);
    ASSERT_EQ(mine.edits.size(), 1u);
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "step4");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M11PartsOfAFieldAreConflatedByThemselves) {
    joinShot();
    const auto sample = [](double time, double value) {
        return authored("/A.x", SetField{"timeSamples", SampleTime{time}, doubleValue(value), {}});
    };
    peer.session.beginGesture();
    peer.author({sample(1, 1), sample(2, 1), sample(1, 2), sample(2, 2)});
    peer.author({authored("/A.x", EraseField{"timeSamples", {}}), sample(1, 3), sample(1, 4)});
    peer.session.endGesture();
    peer.advance();
    const Transaction mine = peer.takeTransaction();
    EXPECT_EQ(mine.edits.size(), 4u);  // two samples, the erase, one sample
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M11APreviewNamesWhatItCreatesByItself) {
    joinShot();
    SessionPeer viewer;
    viewer.commit(viewer.foreign({edit("/A", createPrim()), edit("/A.x", createAttribute()),
                                  edit("/A", setText("comment", "first"))}));
    viewer.connectAndJoin();

    peer.session.beginGesture();
    peer.author({authored("/B", createPrim()), authored("/B.y", createAttribute()),
                 authored("/B.y", setText("comment", "seen"))});
    peer.advance();
    auto preview = peer.take<PreviewFrame>();
    ASSERT_TRUE(preview);
    preview->author = kOther;
    viewer.deliver(*preview);
    viewer.advance();
    EXPECT_EQ(viewer.text("/B.y", "comment"), "seen");
    EXPECT_FALSE(viewer.session.confirmed(kShot)->has("/B"));
}

TEST_F(SessionTest, M11PreviewsAreWithdrawnReplacedAndNeverConfirmed) {
    joinShot();
    const auto preview = [&](std::uint64_t gesture, const std::string& text) {
        peer.deliver(
            PreviewFrame{kOther, gesture, peer.head(), {edit("/A", setText("comment", text))}});
        peer.advance();
    };
    preview(7, "dragging");
    EXPECT_EQ(peer.text("/A", "comment"), "dragging");
    EXPECT_EQ(textOf(*peer.session.confirmed(kShot)->field("/A", "comment")->as<Value>()), "first");
    peer.deliver(PreviewFrame{kOther, 7, peer.head(), {}});
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "first");

    preview(8, "dragging");
    Transaction end = peer.foreign({edit("/A", setText("comment", "dropped"))}, 8);
    peer.commitAndTell(end);
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "dropped");
    EXPECT_TRUE(peer.agrees());

    preview(9, "dragging");
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "dropped");
}

// A spec that exists only in somebody's preview cannot be deleted; but the next edits of the editor
// must be shown as the executor will commit them (M13).
TEST_F(SessionTest, M11ASpecOfAPreviewThatIsCreatedAgainIsPredictedCorrectly) {
    joinShot();
    const auto key = [](const char* name) {
        return SetField{"customData", DictionaryKey{{name}}, stringValue("theirs"), {}};
    };
    peer.deliver(
        PreviewFrame{kOther, 7, peer.head(), {edit("/P", createPrim()), edit("/P", key("a"))}});
    peer.advance();
    Dictionary mine;
    mine.entries["b"] = stringValue("mine");
    peer.author({authored("/P", DeleteSpec{}), authored("/P", createPrim()),
                 authored("/P", SetField{"customData", {}, mine, {}})});
    const auto keys = [&] {
        return peer.session.view(kShot)
            ->field("/P", "customData")
            ->as<Dictionary>()
            ->entries.size();
    };
    EXPECT_EQ(keys(), 2u);
    EXPECT_EQ(peer.editor.at(kShot).field("/P", "customData")->as<Dictionary>()->entries.size(),
              2u);
    peer.deliver(PreviewFrame{kOther, 7, peer.head(), {}});
    peer.advance();
    EXPECT_EQ(keys(), 1u);
}

TEST_F(SessionTest, M11AnOpenGestureFollowsForeignRenames) {
    joinShot();
    peer.session.beginGesture();
    authorComment("/A", "mine");
    peer.commitAndTell(peer.foreign({edit("/A", moveTo("/", "B"))}));
    peer.advance();
    EXPECT_EQ(peer.text("/B", "comment"), "mine");
    authorComment("/B", "still mine");
    peer.session.endGesture();
    peer.advance();
    const Transaction mine = peer.takeTransaction();
    ASSERT_EQ(mine.edits.size(), 1u);
    EXPECT_EQ(mine.edits[0].address.path, "/B");
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, M11AGestureOnANewSpecKeepsItsAddresses) {
    joinShot();
    peer.author({authored("/B", createPrim())});
    peer.advance();
    peer.session.beginGesture();
    peer.author({authored("/B", setText("comment", "mine"))});
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_EQ(peer.text("/B", "comment"), "mine");
    peer.session.endGesture();
    peer.advance();
    const Transaction mine = peer.takeTransaction();
    EXPECT_EQ(mine.edits[0].address, (Address{"/B", {}}));
    peer.commitAndTell(mine);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

// ---- V9: big values

namespace {

struct BigValue {
    SharedBytes bytes;
    Value value;
};
BigValue bigValue(std::uint8_t filling) {
    Bytes bytes(8, 0);
    bytes[2] = 2;  // 131,072 floats
    bytes.resize(8 + 4 * 131'072, filling);
    const Hash hash = sha256(bytes);
    const std::uint64_t size = bytes.size();
    return {std::make_shared<const Bytes>(std::move(bytes)),
            Value::blob(arrayOf(ValueType::Float), hash, size)};
}

}  // namespace

TEST_F(SessionTest, V9ATransactionWaitsForItsBigValuesAndOthersDoNot) {
    joinShot();
    const BigValue big = bigValue(1);
    peer.blobs[big.value.hash()] = big.bytes;
    peer.author({authored("/A.x", SetField{"default", {}, big.value, {}})});
    peer.author({authored("/A", setText("comment", "waits"))});  // later than the waiting one
    peer.author({authored("/B", createPrim())});
    peer.advance();
    const Transaction free = peer.takeTransaction();
    EXPECT_TRUE(std::holds_alternative<CreateSpec>(free.edits[0].action));
    std::uint64_t uploaded = 0;
    for (int frame = 0; frame < 5; ++frame) {
        while (const auto part = peer.take<BlobFrame>()) {
            EXPECT_EQ(part->offset, uploaded);
            uploaded += part->rawBytes;
        }
        peer.advance();
    }
    EXPECT_EQ(uploaded, big.bytes->size());
    peer.deliver(BlobStored{big.value.hash()});
    peer.advance();
    const Transaction first = peer.takeTransaction();
    for (const Transaction& mine : {free, first}) peer.commitAndTell(mine);
    peer.advance();
    const Transaction second = peer.takeTransaction();
    EXPECT_LT(first.id.sequence, second.id.sequence);
    peer.commitAndTell(second);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
}

// A server recognizes the last 1,024 numbers of a client. The number of a waiting transaction must
// be among them when it is sent.
TEST_F(SessionTest, M9NoMoreTransactionsPassAWaitingOneThanAServerRecognizes) {
    joinShot();
    const BigValue big = bigValue(1);
    peer.blobs[big.value.hash()] = big.bytes;
    peer.author({authored("/A.x", SetField{"default", {}, big.value, {}})});
    for (int i = 0; i < 1'100; ++i) peer.author({authored("/B" + std::to_string(i), createPrim())});
    std::size_t sent = 0;
    const auto commitSent = [&] {
        for (int frame = 0; frame < 10; ++frame) {
            peer.advance();
            for (; const auto one = peer.take<SubmitFrame>(); ++sent)
                peer.commitAndTell(one->transaction);
        }
    };
    commitSent();
    EXPECT_EQ(sent, 999u);
    peer.deliver(BlobStored{big.value.hash()});
    commitSent();
    EXPECT_EQ(sent, 1'101u);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, V9ABigValueIsRequestedOnceAndAgainAfterAReconnect) {
    joinShot();
    const BigValue big = bigValue(2);
    const Hash hash = big.value.hash();
    peer.session.requestBlob(hash);
    peer.session.requestBlob(hash);
    EXPECT_TRUE(peer.takeControl<RequestBlob>());
    EXPECT_FALSE(peer.takeControl<RequestBlob>());
    const auto part = [&](std::uint64_t offset, std::size_t count) {
        const ByteView bytes = ByteView(*big.bytes).subspan(offset, count);
        peer.deliver(
            BlobFrame{hash, big.bytes->size(), offset, std::uint32_t(count), deflate(bytes)});
    };
    part(0, kChunkBytes);
    peer.advance();
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.connect();
    peer.advance();
    EXPECT_EQ(peer.takeControl<RequestBlob>()->offset, kChunkBytes) << "TL3";
    part(kChunkBytes, kChunkBytes);
    part(2 * kChunkBytes, big.bytes->size() - 2 * kChunkBytes);
    peer.advance();
    ASSERT_TRUE(peer.blobs.contains(hash));
    EXPECT_EQ(*peer.blobs[hash], *big.bytes);
}

namespace {

EditAction setDefault(const BigValue& big) { return SetField{"default", {}, big.value, {}}; }

// Delivers a complete value.
void deliverBlob(SessionPeer& peer, const BigValue& big) {
    for (std::uint64_t offset = 0; offset < big.bytes->size(); offset += kChunkBytes) {
        const ByteView rest = ByteView(*big.bytes).subspan(offset);
        const ByteView part = rest.first(std::min<std::size_t>(kChunkBytes, rest.size()));
        peer.deliver(BlobFrame{big.value.hash(), big.bytes->size(), offset,
                               std::uint32_t(part.size()), deflate(part)});
    }
}

}  // namespace

TEST_F(SessionTest, B3APreviewFollowsItsBigValuesAndOnlyTheLastOnesAreStored) {
    joinShot();
    std::vector<BigValue> values;
    for (std::uint8_t number = 1; number <= 6; ++number) {
        values.push_back(bigValue(number));
        peer.blobs[values.back().value.hash()] = values.back().bytes;
    }
    peer.sent.clear();
    peer.session.beginGesture();
    std::map<Hash, std::uint64_t> sent;
    std::vector<Hash> shown;
    for (const BigValue& value : values) {
        peer.author({authored("/A.x", setDefault(value))});
        peer.advance();
        for (const Frame& frame : std::exchange(peer.sent, {})) {
            if (const auto* part = std::get_if<BlobFrame>(&frame)) {
                EXPECT_NE(part->gesture, 0u);
                EXPECT_EQ(part->offset, sent[part->hash]);
                sent[part->hash] += part->rawBytes;
            } else if (const auto* preview = std::get_if<PreviewFrame>(&frame)) {
                std::vector<Value> named;
                forEachBlob(std::get<SetField>(preview->edits.back().action).value,
                            [&](const Value& value) { named.push_back(value); });
                ASSERT_EQ(named.size(), 1u);
                EXPECT_EQ(sent[named[0].hash()], values[0].bytes->size()) << "before its value";
                shown.push_back(named[0].hash());
            }
        }
    }
    EXPECT_FALSE(shown.empty());
    EXPECT_LT(shown.size(), values.size()) << "some previews are skipped";
    peer.session.endGesture();
    for (int frame = 0; frame < 5; ++frame) peer.advance();
    for (const Frame& frame : peer.sent)
        if (const auto* part = std::get_if<BlobFrame>(&frame)) {
            EXPECT_EQ(part->gesture, 0u);
            EXPECT_EQ(part->hash, values.back().value.hash());
        }
    peer.deliver(BlobStored{values.back().value.hash()});
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

// The second editor's spec has the path of the removed one. A write to it does not replace those to
// the removed one, which come back to their author as dropped.
TEST_F(SessionTest, B3AGestureStoresTheLastBigValueOfEachSpecThatItWrote) {
    joinShot();
    std::vector<BigValue> values;
    const auto write = [&] {
        values.push_back(bigValue(std::uint8_t(values.size() + 1)));
        peer.blobs[values.back().value.hash()] = values.back().bytes;
        peer.author({authored("/A.x", setDefault(values.back()))});
        peer.advance();
    };
    peer.session.beginGesture();
    write();
    write();
    peer.commitAndTell(peer.foreign({edit("/A", DeleteSpec{})}));
    peer.commitAndTell(peer.foreign({edit("/A", createPrim()), edit("/A.x", createAttribute())}));
    peer.advance();
    write();
    write();
    peer.sent.clear();
    peer.session.endGesture();
    for (int frame = 0; frame < 5; ++frame) peer.advance();
    std::set<Hash> stored;
    for (const Frame& frame : std::exchange(peer.sent, {}))
        if (const auto* part = std::get_if<BlobFrame>(&frame); part && part->gesture == 0)
            stored.insert(part->hash);
    EXPECT_EQ(stored, (std::set<Hash>{values[1].value.hash(), values[3].value.hash()}));
}

TEST_F(SessionTest, B7NamesTheValuesOfPendingWorkAndOfTheGestureAsItIs) {
    joinShot();
    const BigValue first = bigValue(1), second = bigValue(2), third = bigValue(3);
    const auto author = [&](const BigValue& big) {
        peer.blobs[big.value.hash()] = big.bytes;
        peer.author({authored("/A", SetField{"x", {}, big.value, {}})});
    };
    const auto named = [&] { return peer.session.namedBlobs(); };
    EXPECT_TRUE(named().empty());
    author(first);
    peer.session.beginGesture();
    author(second);
    EXPECT_EQ(named(), (std::set<Hash>{first.value.hash(), second.value.hash()}));
    author(third);
    EXPECT_EQ(named(), (std::set<Hash>{first.value.hash(), third.value.hash()}));
    peer.session.endGesture();
    EXPECT_EQ(named(), (std::set<Hash>{first.value.hash(), third.value.hash()}));
}

TEST_F(SessionTest, B3AServerThatWouldStoreThemGetsNoValuesOfPreviews) {
    joinShot();
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.features = {"previews"};
    peer.connect();
    peer.advance();
    peer.sent.clear();
    const BigValue big = bigValue(1);
    peer.blobs[big.value.hash()] = big.bytes;
    peer.session.beginGesture();
    peer.author({authored("/A.x", setDefault(big))});
    for (int frame = 0; frame < 5; ++frame) peer.advance();
    EXPECT_TRUE(peer.sent.empty());
}

TEST_F(SessionTest, B4TheNewestPreviewWithAllItsBigValuesIsShown) {
    joinShot();
    const BigValue values[] = {bigValue(1), bigValue(2), bigValue(3), bigValue(4)};
    const auto preview = [&](int number) {
        peer.deliver(
            PreviewFrame{kOther, 5, peer.head(), {edit("/A.x", setDefault(values[number]))}});
        peer.advance();
    };
    const auto shows = [&](int number) {
        const FieldValue* value = peer.editor.at(kShot).field("/A.x", "default");
        return value && *value == FieldValue(values[number].value);
    };
    peer.sent.clear();
    preview(0);
    preview(1);
    preview(2);
    EXPECT_FALSE(shows(0));
    EXPECT_EQ(peer.takeControl<RequestBlob>()->hash, values[0].value.hash());
    EXPECT_FALSE(peer.takeControl<RequestBlob>());
    deliverBlob(peer, values[0]);
    peer.advance();
    EXPECT_TRUE(shows(0));
    EXPECT_EQ(peer.takeControl<RequestBlob>()->hash, values[2].value.hash()) << "1 is passed over";
    // The server does not have this value any more; there is a newer one.
    preview(3);
    peer.deliver(ErrorMessage{"blobNotFound", "gone", false, {}, values[2].value.hash()});
    peer.advance();
    EXPECT_TRUE(shows(0));
    EXPECT_EQ(peer.takeControl<RequestBlob>()->hash, values[3].value.hash());
    EXPECT_TRUE(peer.eventsOf<event::ServerError>().empty());
    // A commit is always shown.
    peer.commitAndTell(peer.foreign({edit("/A.x", setDefault(values[3]))}, 5));
    peer.advance();
    EXPECT_TRUE(shows(3));
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, B5AFailedDownloadIsRequestedAgainAsLongAsItIsNeeded) {
    joinShot();
    const BigValue big = bigValue(2);
    const Hash hash = big.value.hash();
    peer.session.requestBlob(hash);
    peer.sent.clear();
    const auto fail = [&] {
        peer.deliver(ErrorMessage{"blobNotFound", "not yet", false, {}, hash});
        peer.advance();
    };
    const auto framesUntilAsked = [&] {
        for (int frame = 1; frame < 10'000; ++frame) {
            peer.advance();
            if (peer.takeControl<RequestBlob>()) return frame;
        }
        return 0;
    };
    fail();
    const int first = framesUntilAsked();
    fail();
    const int second = framesUntilAsked();
    EXPECT_GT(first, 1);
    EXPECT_GT(second, first);
    EXPECT_EQ(peer.eventsOf<event::ServerError>().size(), 1u) << "the error is reported once";
    fail();
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.connect();
    peer.advance();
    EXPECT_TRUE(peer.takeControl<RequestBlob>());
    fail();
    peer.needed = false;
    EXPECT_EQ(framesUntilAsked(), 0);
}

TEST_F(SessionTest, B1WorkThatBuildsOnARefusedValueComesAfterIt) {
    joinShot();
    const BigValue big = bigValue(1);
    peer.blobs[big.value.hash()] = big.bytes;
    const auto upload = [&] {
        for (int frame = 0; frame < 5; ++frame) peer.advance();
        peer.deliver(BlobStored{big.value.hash()});
        peer.advance();
    };
    peer.author({authored("/New", createPrim()), authored("/New.x", createAttribute()),
                 authored("/New.x", setDefault(big))});
    peer.author({authored("/New.x", setText("comment", "builds on it"))});
    peer.author({authored("/Apart", createPrim())});
    upload();
    std::vector<Transaction> first;
    for (auto frame = peer.take<SubmitFrame>(); frame; frame = peer.take<SubmitFrame>())
        first.push_back(frame->transaction);
    ASSERT_EQ(first.size(), 2u) << "dependent work waits";
    std::ranges::sort(first, {}, [](const Transaction& one) { return one.id.sequence; });
    peer.deliver(RefusalFrame{first[0].id.sequence, 2, {ErrorCode::BlobNotFound, "collected"}});
    peer.commitAndTell(first[1]);
    peer.sent.clear();
    upload();
    const Transaction again = peer.takeTransaction();
    EXPECT_EQ(again.id, first[0].id)
        << "M9: with new numbers the server would forget the waiting ones";
    peer.commitAndTell(again);
    peer.advance();
    const Commit built = peer.commitAndTell(peer.takeTransaction());
    EXPECT_TRUE(built.dropped.empty());
    peer.advance();
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, B1AnUploadThatIsRefusedIsSentAgain) {
    joinShot();
    const BigValue big = bigValue(1);
    peer.blobs[big.value.hash()] = big.bytes;
    peer.author({authored("/A.x", setDefault(big))});
    for (int frame = 0; frame < 5; ++frame) peer.advance();
    peer.sent.clear();
    peer.deliver(ErrorMessage{"blobMismatch", "another client", false, {}, big.value.hash()});
    peer.deliver(ErrorMessage{"blobMismatch", "another client", false, {}, big.value.hash()});
    for (int frame = 0; frame < 100; ++frame) peer.advance();
    EXPECT_EQ(peer.take<BlobFrame>()->offset, 0u);
    for (const Frame& frame : peer.sent) EXPECT_FALSE(std::holds_alternative<SubmitFrame>(frame));
    peer.deliver(BlobStored{big.value.hash()});
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

// The last part before the cut is sent again: nobody knows whether it arrived.
TEST_F(SessionTest, TL2AnUploadContinuesWhereTheConnectionWasLost) {
    joinShot();
    const BigValue big = bigValue(1);
    peer.blobs[big.value.hash()] = big.bytes;
    peer.author({authored("/A.x", setDefault(big))});
    peer.advance();
    std::vector<std::uint64_t> offsets;
    const auto takeParts = [&] {
        offsets.clear();
        while (const auto part = peer.take<BlobFrame>()) offsets.push_back(part->offset);
    };
    takeParts();
    EXPECT_EQ(offsets, (std::vector<std::uint64_t>{0, kChunkBytes, 2 * kChunkBytes}));
    const auto reconnect = [&](std::size_t unconfirmed) {
        peer.session.disconnected({ErrorCode::NotConnected, "cut"}, unconfirmed);
        peer.advance();
        peer.connect();
        peer.advance();
        takeParts();
    };
    reconnect(0);
    EXPECT_EQ(offsets, std::vector<std::uint64_t>{2 * kChunkBytes}) << "its answer was lost";
    reconnect(1);
    EXPECT_EQ(offsets, std::vector<std::uint64_t>{2 * kChunkBytes});
    reconnect(10'000'000);
    EXPECT_EQ(offsets, std::vector<std::uint64_t>{2 * kChunkBytes}) << "before are earlier ones";
    peer.takesParts = false;  // cut again before a part could be sent
    reconnect(0);
    reconnect(0);
    EXPECT_TRUE(offsets.empty());
    peer.takesParts = true;
    peer.advance();
    takeParts();
    EXPECT_EQ(offsets, std::vector<std::uint64_t>{2 * kChunkBytes});
    // The server has dropped what had arrived.
    peer.deliver(ErrorMessage{"blobMismatch", "nothing to continue", false, {}, big.value.hash()});
    for (int frame = 0; frame < 100; ++frame) peer.advance();
    takeParts();
    EXPECT_EQ(offsets, (std::vector<std::uint64_t>{0, kChunkBytes, 2 * kChunkBytes}));
    peer.deliver(BlobStored{big.value.hash()});
    peer.advance();
    peer.commitAndTell(peer.takeTransaction());
    peer.advance();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionTest, V9BytesOfAnotherValueAreRefused) {
    joinShot();
    const Hash hash = sha256(asBytes("what was asked for"));
    const Bytes bytes(10, 1);
    peer.session.requestBlob(hash);
    peer.deliver(BlobFrame{hash, bytes.size(), 0, std::uint32_t(bytes.size()), deflate(bytes)});
    peer.advance();
    EXPECT_FALSE(peer.blobs.contains(hash));
    ASSERT_EQ(peer.eventsOf<event::ServerError>().size(), 1u);
    EXPECT_EQ(peer.eventsOf<event::ServerError>()[0].message.code, "blobMismatch");
}

// ---- requests

TEST_F(SessionTest, APeekShowsALayerWithoutJoiningIt) {
    joinShot();
    std::optional<LayerDoc> seen;
    peer.session.peek(kLook, 0, [&](Result<LayerDoc> doc, Revision) { seen = *doc; });
    peer.sendSnapshot(*peer.takeControl<OpenLayer>());
    peer.advance();
    ASSERT_TRUE(seen);
    EXPECT_FALSE(peer.session.isJoined(kLook));
    std::optional<Error> error;
    peer.session.peek({"none.usda"}, 5,
                      [&](Result<LayerDoc> doc, Revision) { error = doc.error(); });
    const auto open = peer.takeControl<OpenLayer>();
    EXPECT_EQ(open->revision, 5u);
    peer.deliver(ErrorMessage{"layerNotFound", "no", false, open->request, {}});
    peer.advance();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, ErrorCode::LayerNotFound);
}

TEST_F(SessionTest, TheLogIsReadBesideTheStream) {
    joinShot();
    peer.commitAndTell(peer.foreign({edit("/B", createPrim())}));
    peer.advance();
    std::vector<Revision> seen;
    bool done = false;
    peer.session.requestLog(
        1, 0, [&](const Commit& commit) { seen.push_back(commit.revision); },
        [&](Result<void> result) { done = result.has_value(); });
    const auto request = peer.takeControl<RequestLog>();
    ASSERT_TRUE(request);
    peer.deliver(LogBegin{request->request});
    peer.deliverCommit(1);
    peer.deliverCommit(2);
    peer.deliver(LogEnd{request->request});
    peer.commitAndTell(peer.foreign({edit("/C", createPrim())}));
    peer.advance();
    EXPECT_EQ(seen, (std::vector<Revision>{1, 2}));
    EXPECT_TRUE(done);
    EXPECT_EQ(peer.session.revision(), 3u);
}

TEST_F(SessionTest, ARequestLostWithItsConnectionIsAnswered) {
    joinShot();
    std::optional<Error> error;
    peer.session.requestLog(
        1, 0, [](const Commit&) {}, [&](Result<void> result) { error = result.error(); });
    peer.session.request(SaveLayers{});
    peer.session.disconnected({ErrorCode::NotConnected, "away"});
    peer.advance();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, ErrorCode::NotConnected);
    EXPECT_EQ(peer.eventsOf<event::ServerError>().size(), 1u);
    EXPECT_EQ(peer.eventsOf<event::Disconnected>().size(), 1u);
}

TEST_F(SessionTest, TheClosingErrorOfAServerIsReported) {
    joinShot();
    peer.deliver(ErrorMessage{"shuttingDown", "bye", true, {}, {}});
    peer.session.disconnected({ErrorCode::NotConnected, "closed"});
    peer.advance();
    ASSERT_EQ(peer.eventsOf<event::ServerError>().size(), 1u);
    EXPECT_EQ(peer.eventsOf<event::ServerError>()[0].message.code, "shuttingDown");
}
