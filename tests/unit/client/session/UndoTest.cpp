// Undo and redo of a session, against a server that does only what a test requests.
#include <gtest/gtest.h>

#include <algorithm>

#include "SessionPeer.h"
#include "session/UndoStack.h"

using namespace usdlive;
using namespace usdlive::client;
using namespace usdlive::client::sessiontest;

namespace {

class UndoTest : public ::testing::Test {
protected:
    SessionPeer peer;

    // A shot with the prims /A and /B; /A has the attribute x.
    void SetUp() override {
        peer.commit(peer.foreign({edit("/A", createPrim()), edit("/A.x", createAttribute()),
                                  edit("/B", createPrim()), edit("/A", setText("comment", "0"))}));
        peer.connectAndJoin();
    }
    void author(std::vector<AuthoredEdit> edits) {
        peer.author(std::move(edits));
        peer.advance();
    }
    void comment(const std::string& path, const std::string& text) {
        author({authored(path, setText("comment", text))});
    }
    // The server commits all own transactions.
    void commitOwn() {
        while (const auto submit = peer.take<SubmitFrame>())
            peer.commitAndTell(submit->transaction);
        peer.advance();
    }
    void othersWrite(std::vector<Edit> edits) {
        peer.commitAndTell(peer.foreign(std::move(edits)));
        peer.advance();
    }
    UndoResult undo() { return taken(peer.session.undo()); }
    UndoResult redo() { return taken(peer.session.redo()); }
    UndoResult taken(Result<UndoResult> result) {
        EXPECT_TRUE(result) << result.error().message;
        EXPECT_TRUE(peer.agrees());
        peer.advance();
        return *std::move(result);
    }
    [[nodiscard]] std::string dump() const { return peer.editor.at(kShot).dump(); }
    [[nodiscard]] std::vector<std::string> prims() const {
        return peer.editor.at(kShot).children("/", ChildList::Prims);
    }
    static std::vector<std::string> paths(const UndoResult& result) {
        std::vector<std::string> paths;
        for (const KeptByUndo& one : result.kept) paths.push_back(one.path + " " + one.field);
        return paths;
    }
};

using Names = std::vector<std::string>;

}  // namespace

TEST_F(UndoTest, NothingToUndoIsAResult) {
    EXPECT_FALSE(undo().done);
    EXPECT_FALSE(redo().done);
}

TEST_F(UndoTest, EachTransactionIsAStep) {
    comment("/A", "1");
    commitOwn();
    comment("/A", "2");
    EXPECT_TRUE(undo().done);
    EXPECT_EQ(peer.text("/A", "comment"), "1");
    commitOwn();
    EXPECT_TRUE(undo().done);
    EXPECT_EQ(peer.text("/A", "comment"), "0");
    EXPECT_FALSE(undo().done);
    redo();
    redo();
    EXPECT_EQ(peer.text("/A", "comment"), "2");
    commitOwn();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(UndoTest, ANewEditEndsWhatCanBeRedone) {
    comment("/A", "1");
    undo();
    comment("/B", "1");
    EXPECT_FALSE(redo().done);
}

TEST_F(UndoTest, SE15StepsStayApartWhereTransactionsAreWrittenAgain) {
    peer.session.disconnected({ErrorCode::NotConnected, "lost"});
    for (const char* text : {"1", "2", "3"}) comment("/A", text);
    EXPECT_EQ(peer.session.pendingTransactions(), 1u);
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "2");
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "1");
    redo();
    EXPECT_EQ(peer.text("/A", "comment"), "2");
    peer.connect();
    peer.advance();
    commitOwn();
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "1");
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "0");
}

TEST_F(UndoTest, AGroupIsOneStepWithItsLabel) {
    peer.session.beginUndoGroup("Paint");
    comment("/A", "1");
    comment("/B", "1");
    EXPECT_EQ(peer.session.undo().error().code, ErrorCode::InvalidArgument);
    peer.session.endUndoGroup();
    EXPECT_EQ(peer.session.undoLabels().undo, Names{"Paint"});
    EXPECT_EQ(undo().label, "Paint");
    EXPECT_EQ(peer.text("/A", "comment") + peer.text("/B", "comment"), "0-");
    EXPECT_EQ(peer.session.undoLabels().redo, Names{"Paint"});
}

TEST_F(UndoTest, M18TheCommitsOfAGroupHaveItsLabel) {
    const auto labels = [&] {
        std::vector<std::string> all;
        while (const auto submit = peer.take<SubmitFrame>())
            all.push_back(submit->transaction.label);
        return all;
    };
    labels();
    peer.session.beginUndoGroup("Paint\nwalls");
    comment("/A", "1");
    comment("/B", "1");
    peer.session.endUndoGroup();
    comment("/A", "2");  // SE15: it may not replace the value of the group
    peer.advance();
    EXPECT_EQ(labels(), (Names{"Paint walls", "Paint walls", ""}));
    peer.session.beginUndoGroup(std::string(2'000, 'x') + "\xff");
    peer.session.beginGesture();
    comment("/A", "3");
    peer.session.endGesture();
    peer.session.endUndoGroup();
    undo();
    peer.advance();
    EXPECT_EQ(labels(), (Names{std::string(1'000, 'x'), "Undo: " + std::string(994, 'x')}));
}

TEST_F(UndoTest, AGestureIsOneStep) {
    peer.session.beginGesture();
    for (const char* text : {"1", "2", "3"}) comment("/A", text);
    comment("/B", "1");
    EXPECT_EQ(peer.session.undo().error().code, ErrorCode::InvalidArgument);
    peer.session.endGesture();
    const std::string after = dump();
    undo();
    EXPECT_EQ(peer.text("/A", "comment") + peer.text("/B", "comment"), "0-");
    redo();
    EXPECT_EQ(dump(), after);
}

TEST_F(UndoTest, WhatOthersHaveWrittenSinceIsKeptAndNamed) {
    author({authored("/A", setText("comment", "1")), authored("/B", setText("comment", "1"))});
    commitOwn();
    othersWrite({edit("/A", setText("comment", "theirs"))});
    const UndoResult result = undo();
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
    EXPECT_EQ(peer.text("/B", "comment"), "-");
    EXPECT_EQ(paths(result), Names{"/A comment"});
    EXPECT_EQ(result.kept.at(0).author.value, "user");
    EXPECT_EQ(result.kept.at(0).layer, kShot);
}

// Equal contents do not tell who wrote them.
TEST_F(UndoTest, TheSameValueThatOthersHaveWrittenIsKept) {
    comment("/A", "1");
    commitOwn();
    othersWrite({edit("/A", setText("comment", "1"))});
    EXPECT_EQ(undo().kept.size(), 1u);
    EXPECT_EQ(peer.text("/A", "comment"), "1");
}

// The edit has replaced the value that somebody else has committed before it.
TEST_F(UndoTest, TheValueIsThatWhichTheCommitHasReplaced) {
    comment("/A", "mine");
    peer.commitAndTell(peer.foreign({edit("/A", setText("comment", "theirs"))}));
    peer.advance();
    undo();  // pending
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
    redo();
    commitOwn();
    EXPECT_EQ(peer.text("/A", "comment"), "mine");
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
}

TEST_F(UndoTest, AnEditFollowsAMoveByOthers) {
    comment("/A", "1");
    commitOwn();
    othersWrite({edit("/A", moveTo("/B", "C"))});
    EXPECT_TRUE(undo().kept.empty());
    EXPECT_EQ(peer.text("/B/C", "comment"), "0");
}

TEST_F(UndoTest, ARenameGoesBackWithWhatOthersHaveWrittenSince) {
    author({authored("/A", moveTo("/B", "C"))});
    commitOwn();
    othersWrite({edit("/B/C", setText("comment", "theirs"))});
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"})) << "with its place among the siblings";
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
    redo();
    EXPECT_EQ(peer.text("/B/C", "comment"), "theirs");
}

TEST_F(UndoTest, ARenameThatOthersHaveRenamedAgainIsKept) {
    author({authored("/A", moveTo("/", "C"))});
    commitOwn();
    othersWrite({edit("/C", moveTo("/", "D"))});
    EXPECT_EQ(paths(undo()), Names{"/D "});
    EXPECT_EQ(prims(), (Names{"D", "B"}));
}

TEST_F(UndoTest, ADeletedSubtreeReturnsWithWhatOthersDidBefore) {
    author({authored("/A", DeleteSpec{})});
    peer.commitAndTell(peer.foreign(
        {edit("/A.x", setText("comment", "theirs")), edit("/A/Theirs", createPrim())}));
    commitOwn();
    EXPECT_EQ(prims(), Names{"B"});
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    EXPECT_EQ(peer.text("/A.x", "comment"), "theirs");
    EXPECT_TRUE(peer.editor.at(kShot).has("/A/Theirs"));
    commitOwn();
    EXPECT_TRUE(peer.agrees());
}

TEST_F(UndoTest, StepsBeforeADeleteFollowTheSubtreeThatReturns) {
    comment("/A", "1");
    author({authored("/A", DeleteSpec{})});
    commitOwn();
    undo();
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "0");
    redo();
    EXPECT_EQ(peer.text("/A", "comment"), "1");
    redo();
    EXPECT_EQ(prims(), Names{"B"});
}

TEST_F(UndoTest, ACreatedSpecGoesWithWhatThisUserDidBelow) {
    author({authored("/C", createPrim()), authored("/C/D", createPrim()),
            authored("/C/D", setText("comment", "1"))});
    commitOwn();
    const std::string after = dump();
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    redo();
    EXPECT_EQ(dump(), after);
}

// ED8: the server refuses an attribute without a type.
TEST_F(UndoTest, ED8AnAttributeKeepsItsTypeUntilItGoes) {
    const std::string before = dump();
    author({authored("/A.y", createAttribute())});
    author({authored("/A.y", SetField{"typeName", {}, tokenValue("double"), {}})});
    commitOwn();
    for (int count = 0; count < 2; ++count) {
        undo();
        commitOwn();
    }
    EXPECT_EQ(dump(), before);
    EXPECT_TRUE(peer.eventsOf<event::Lost>().empty());
}

TEST_F(UndoTest, ACreatedSpecStaysWithTheWorkOfOthers) {
    author({authored("/C", createPrim()), authored("/C/Mine", createPrim()),
            authored("/C/Both", createPrim())});
    commitOwn();
    othersWrite({edit("/C/Both/Theirs", createPrim())});
    const UndoResult result = undo();
    EXPECT_EQ(paths(result), Names{"/C/Both/Theirs "});
    EXPECT_EQ(peer.editor.at(kShot).children("/C", ChildList::Prims), Names{"Both"});
    redo();
    EXPECT_EQ(peer.editor.at(kShot).children("/C", ChildList::Prims), (Names{"Mine", "Both"}));
}

TEST_F(UndoTest, ASpecThatOthersHaveCreatedFirstIsNotDeleted) {
    author({authored("/C", createPrim()), authored("/C", setText("comment", "mine"))});
    peer.commitAndTell(peer.foreign({edit("/C", createPrim())}));
    commitOwn();
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B", "C"}));
    EXPECT_EQ(peer.text("/C", "comment"), "-");
}

TEST_F(UndoTest, WhatWasMovedIntoACreatedSpecMovesOut) {
    author({authored("/C", createPrim()), authored("/A", moveTo("/C", "A"))});
    commitOwn();
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    redo();
    EXPECT_EQ(prims(), (Names{"B", "C"}));
}

TEST_F(UndoTest, EditsOfWhatWasMovedIntoACreatedSpecAreTakenBack) {
    author({authored("/C", createPrim()), authored("/A", moveTo("/C", "A")),
            authored("/C/A", setText("comment", "1")), authored("/C", DeleteSpec{})});
    commitOwn();
    const std::string after = dump();
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    EXPECT_EQ(peer.text("/A", "comment"), "0");
    redo();
    EXPECT_EQ(dump(), after);
}

// A move that is kept must not go with the spec that was created for it.
TEST_F(UndoTest, WhatStaysInACreatedSpecKeepsIt) {
    author({authored("/C", createPrim())});
    author({authored("/A", moveTo("/C", "A"))});
    commitOwn();
    othersWrite({edit("/A", createPrim())});
    EXPECT_EQ(undo().kept.size(), 1u);
    EXPECT_EQ(undo().kept.size(), 1u);
    EXPECT_TRUE(peer.editor.at(kShot).has("/C/A.x"));
}

TEST_F(UndoTest, AnOrderIsRestored) {
    author({authored("/A", PlaceSpec{""})});
    EXPECT_EQ(prims(), (Names{"B", "A"}));
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    redo();
    commitOwn();
    othersWrite({edit("/A", PlaceSpec{"B"}), edit("/A", PlaceSpec{""})});
    EXPECT_EQ(undo().kept.size(), 1u);
}

// M15: the objects of other layers move back, too, and with them what others name.
TEST_F(UndoTest, M15ABatchGoesBackInAllLayers) {
    peer.join(kLook);
    author({authored("/A", moveTo("/", "C")), authored("/A", MoveSpec{{"/", {}}, "C", true}),
            authored("/A", MoveSpec{{"/", {}}, "C", true}, kLook)});
    commitOwn();
    undo();
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    const auto submit = peer.take<SubmitFrame>();
    ASSERT_TRUE(submit);
    const auto& edits = submit->transaction.edits;
    EXPECT_TRUE(std::ranges::any_of(edits, [](const Edit& one) {
        return one.layer == kLook && one.address.path == "/C" && concernsPlace(one.action);
    }));
    peer.commitAndTell(submit->transaction);
    peer.advance();
    EXPECT_TRUE(peer.agrees());
    redo();
    commitOwn();
    EXPECT_EQ(prims(), (Names{"C", "B"}));
}

TEST_F(UndoTest, WorkThatWasRefusedLeavesTheStack) {
    comment("/A", "1");
    comment("/B", "1");
    const auto first = peer.take<SubmitFrame>();
    peer.deliver(
        RefusalFrame{first->transaction.id.sequence, 0, {ErrorCode::Locked, "locked by somebody"}});
    peer.advance();
    EXPECT_EQ(peer.session.undoLabels().undo.size(), 1u);
    commitOwn();
    undo();
    EXPECT_EQ(peer.text("/A", "comment") + peer.text("/B", "comment"), "0-");
}

TEST_F(UndoTest, AnUndoThatWasRefusedCanBeMadeAgain) {
    comment("/A", "1");
    commitOwn();
    undo();
    const auto sent = peer.take<SubmitFrame>();
    ASSERT_TRUE(sent);
    peer.deliver(
        RefusalFrame{sent->transaction.id.sequence, 0, {ErrorCode::Locked, "locked by somebody"}});
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "1");
    EXPECT_EQ(peer.eventsOf<event::Lost>().size(), 1u);
    EXPECT_FALSE(redo().done);
    undo();
    EXPECT_EQ(peer.text("/A", "comment"), "0");
}

TEST_F(UndoTest, ARefusedDeleteLeavesEarlierStepsAsTheyAre) {
    comment("/A", "1");
    commitOwn();
    author({authored("/A", DeleteSpec{})});
    const auto sent = peer.take<SubmitFrame>();
    peer.deliver(
        RefusalFrame{sent->transaction.id.sequence, 0, {ErrorCode::Locked, "locked by somebody"}});
    peer.advance();
    EXPECT_EQ(peer.text("/A", "comment"), "1");
    EXPECT_TRUE(undo().kept.empty());
    EXPECT_EQ(peer.text("/A", "comment"), "0");
}

TEST_F(UndoTest, OfflineAndAfterReconnecting) {
    comment("/A", "1");
    commitOwn();
    peer.session.disconnected({ErrorCode::NotConnected, "lost"});
    peer.advance();
    comment("/B", "1");
    undo();
    undo();
    EXPECT_EQ(peer.text("/A", "comment") + peer.text("/B", "comment"), "0-");
    peer.commit(peer.foreign({edit("/B", setText("comment", "theirs"))}));
    peer.connect();
    peer.advance();
    commitOwn();
    EXPECT_TRUE(peer.agrees());
    redo();
    EXPECT_EQ(peer.text("/A", "comment"), "1");
}

TEST_F(UndoTest, AClosedLayerLeavesTheSteps) {
    comment("/A", "1");
    commitOwn();
    peer.session.closeLayer(kShot);
    peer.editor.erase(kShot);
    peer.advance();
    EXPECT_FALSE(peer.session.undo()->done);
}

TEST_F(UndoTest, TheNumberOfStepsIsBounded) {
    for (std::size_t step = 0; step < UndoStack::kMostSteps + 10; ++step) {
        comment("/A", std::to_string(step));
        commitOwn();
    }
    EXPECT_EQ(peer.session.undoLabels().undo.size(), UndoStack::kMostSteps);
}

TEST_F(UndoTest, TheMemoryOfStepsIsBounded) {
    const std::string large(UndoStack::kMostBytes / 4, 'x');
    for (int step = 0; step < 6; ++step) {
        comment("/A", large + std::to_string(step));
        commitOwn();
    }
    EXPECT_LE(peer.session.undoLabels().undo.size(), 2u);
    EXPECT_GE(peer.session.undoLabels().undo.size(), 1u);
}

// Any number of undos and as many redos restore the layer exactly, also while others edit
// elsewhere.
TEST_F(UndoTest, UndosAndRedosRestoreTheLayerWhileOthersEditElsewhere) {
    author({authored("/C", createPrim()), authored("/C", setText("comment", "c"))});
    comment("/A", "1");
    author({authored("/A", moveTo("/C", "D"))});
    author({authored("/C", PlaceSpec{"B"})});
    author({authored("/C/D", DeleteSpec{})});
    commitOwn();
    const auto ofC = [this] {
        std::string text;
        peer.editor.at(kShot).visit(
            "/C", [&](const LayerDoc::SpecView& spec) { text += std::string(spec.path) + " "; });
        return text + prims().at(0) + peer.text("/C", "comment");
    };
    const std::string after = ofC();
    for (int step = 0; step < 5; ++step) {
        undo();
        commitOwn();
        othersWrite({edit("/B", setText("comment", std::to_string(step)))});
    }
    EXPECT_EQ(prims(), (Names{"A", "B"}));
    EXPECT_EQ(peer.text("/A", "comment"), "0");
    for (int step = 0; step < 5; ++step) {
        redo();
        commitOwn();
        othersWrite({edit("/B", setText("comment", std::to_string(step)))});
    }
    EXPECT_EQ(ofC(), after);
    EXPECT_EQ(peer.text("/B", "comment"), "4");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(UndoTest, WhatOthersHaveWrittenElsewhereStaysWhenItIsMovedBackBelowACreatedSpec) {
    author({authored("/C", createPrim())});
    commitOwn();
    author({authored("/C/D", createPrim())});
    commitOwn();
    author({authored("/C/D", MoveSpec{{"/", {}}, "E"})});
    commitOwn();
    othersWrite({edit("/E", setText("comment", "theirs"))});
    EXPECT_TRUE(undo().done);  // it is /C/D again
    commitOwn();
    EXPECT_EQ(paths(undo()), Names{"/C/D "});
    commitOwn();
    EXPECT_EQ(paths(undo()), Names{"/C/D "});
    commitOwn();
    EXPECT_EQ(peer.text("/C/D", "comment"), "theirs");
}

TEST_F(UndoTest, WhatOthersHaveWrittenInAMovedSpecStaysWhenItsFormerParentGoes) {
    author({authored("/C", createPrim()), authored("/C/D", createPrim())});
    commitOwn();
    author({authored("/C/D", MoveSpec{{"/", {}}, "E"})});
    commitOwn();
    othersWrite({edit("/E/F", createPrim())});
    EXPECT_TRUE(undo().done);
    commitOwn();
    EXPECT_EQ(paths(undo()), Names{"/C/D/F "});
    commitOwn();
    EXPECT_TRUE(peer.editor.at(kShot).has("/C/D/F"));
}

TEST_F(UndoTest, AMovedSpecWhoseFormerParentIsGoneStaysWithItsNewParent) {
    author({authored("/C", createPrim())});
    commitOwn();
    author({authored("/A.x", MoveSpec{{"/C", {}}, "x"})});
    commitOwn();
    othersWrite({edit("/A", DeleteSpec{})});
    EXPECT_EQ(paths(undo()), Names{"/C.x "});
    commitOwn();
    EXPECT_EQ(paths(undo()), Names{"/C.x "});
    commitOwn();
    EXPECT_TRUE(peer.editor.at(kShot).has("/C.x"));
}
