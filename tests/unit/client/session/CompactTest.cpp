// Tests compact frames and acceptances in a session (FR9-FR11).
#include <gtest/gtest.h>

#include "SessionPeer.h"
#include "usdlive/common/protocol/CompactFrame.h"

namespace usdlive::client::sessiontest {
namespace {

/// A server that knows compact frames.
class CompactPeer : public SessionPeer {
public:
    CompactPeer() { features.emplace_back(kCompactFeature); }

    void send(SharedBytes frames) override {
        const auto split = splitMessage(*frames);
        for (const ByteView frame : *split) {
            if (!isCompact(frame)) {
                sent.push_back(*decodeFrame(frame));
                continue;
            }
            ++compactFrames;
            auto content = fromSession.read(frame);
            if (!content) throw std::runtime_error(content.error().message);
            if (auto* submit = std::get_if<SubmitFrame>(&*content)) {
                submit->transaction.id.client = kMe;
                sent.emplace_back(std::move(*submit));
            } else if (auto* preview = std::get_if<PreviewFrame>(&*content)) {
                sent.emplace_back(std::move(*preview));
            }
        }
    }
    void connectAgain() {
        fromSession = {};
        connect();
        advance();
    }
    /// Commits a transaction of the session, and answers with an acceptance.
    Commit commitAndAccept(const Transaction& transaction) {
        Commit made = commit(transaction);
        session.received(
            reader->read(encodeAcceptance({made.revision, made.epoch, made.id.sequence, made.timeMs,
                                           made.previous, hashAt(head())})));
        return made;
    }

    CompactReader fromSession;
    std::size_t compactFrames = 0;
};

class SessionCompact : public testing::Test {
protected:
    void SetUp() override {
        peer.connectAndJoin();
        peer.author({authored("/A", createPrim()), authored("/A.x", createAttribute())});
        peer.advance();
        // FR11: an address by number becomes a path in the commit, so the author gets the commit.
        peer.commitAndTell(peer.takeTransaction());
        peer.advance();
        peer.events.clear();
    }
    void write(const std::string& text) {
        peer.author({authored("/A", setText("comment", text))});
        peer.advance();
    }
    CompactPeer peer;
};

TEST_F(SessionCompact, FR9TransactionsAreCompact) {
    EXPECT_GT(peer.compactFrames, 0u);
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_TRUE(peer.agrees());
    for (int time = 0; time < 4; ++time) {
        write(std::to_string(time));
        peer.commitAndAccept(peer.takeTransaction());
        peer.advance();
    }
    EXPECT_EQ(peer.text("/A", "comment"), "3");
    EXPECT_TRUE(peer.agrees());
}

TEST_F(SessionCompact, FR11AnAcceptanceIsTheCommitOfTheOwnTransaction) {
    write("mine");
    const Commit made = peer.commitAndAccept(peer.takeTransaction());
    peer.advance();
    const auto committed = peer.eventsOf<event::Committed>();
    ASSERT_EQ(committed.size(), 1u);
    EXPECT_EQ(committed[0].commit, made);
    EXPECT_EQ(peer.session.revision(), made.revision);
    // The chain continues from its hash: a commit in another form follows.
    peer.commitAndTell(peer.foreign({edit("/A", setText("comment", "theirs"))}));
    peer.advance();
    EXPECT_EQ(peer.session.revision(), peer.head());
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
}

TEST_F(SessionCompact, FR11AnAcceptanceWithAnotherHistoryIsRefused) {
    write("mine");
    const Commit made = peer.commit(peer.takeTransaction());
    Acceptance other{made.revision, made.epoch, made.id.sequence, 0, made.previous, {}};
    other.previous.bytes[0] ^= 1;
    peer.session.received(peer.reader->read(encodeAcceptance(other)));
    peer.advance();
    const auto errors = peer.eventsOf<event::ServerError>();
    ASSERT_EQ(errors.size(), 1u);
    EXPECT_EQ(errors[0].message.code, "historyDiverged");
    EXPECT_EQ(peer.session.pendingTransactions(), 1u) << "the work is kept";
}

TEST_F(SessionCompact, FR11AnAcceptanceOfUnknownWorkConnectsAgain) {
    const Commit made = peer.commit(peer.foreign({edit("/A", setText("comment", "theirs"))}));
    peer.session.received(peer.reader->read(
        encodeAcceptance({made.revision, made.epoch, 900, 0, made.previous, peer.hashAt(2)})));
    peer.advance();
    const auto errors = peer.eventsOf<event::ServerError>();
    ASSERT_EQ(errors.size(), 1u);
    EXPECT_TRUE(errors[0].message.closing);
    peer.session.disconnected({ErrorCode::NotConnected, "closed"});
    peer.connectAgain();
    EXPECT_EQ(peer.session.revision(), peer.head());
    EXPECT_EQ(peer.text("/A", "comment"), "theirs");
}

TEST_F(SessionCompact, FR10NumbersBeginAnewWithEachConnection) {
    for (int time = 0; time < 3; ++time) {
        write(std::to_string(time));
        peer.commitAndAccept(peer.takeTransaction());
        peer.advance();
    }
    write("unanswered");
    (void)peer.takeTransaction();
    peer.session.disconnected({ErrorCode::NotConnected, "lost"});
    peer.connectAgain();
    EXPECT_EQ(peer.takeTransaction().edits.size(), 1u) << "read without the names of before";
}

TEST_F(SessionCompact, FR9AnOlderServerGetsOtherFrames) {
    peer.session.disconnected({ErrorCode::NotConnected, "lost"});
    peer.features.pop_back();
    peer.connectAgain();
    peer.compactFrames = 0;
    write("plain");
    EXPECT_EQ(peer.takeTransaction().edits.size(), 1u);
    EXPECT_EQ(peer.compactFrames, 0u);
}

TEST_F(SessionCompact, M11PreviewsAreCompact) {
    peer.session.beginGesture();
    write("dragged");
    const auto preview = peer.take<PreviewFrame>();
    ASSERT_TRUE(preview);
    EXPECT_EQ(preview->edits.size(), 1u);
    EXPECT_TRUE(preview->author.empty());
    peer.session.endGesture();
    peer.advance();
    const Commit made = peer.commitAndAccept(peer.takeTransaction());
    peer.advance();
    EXPECT_NE(made.gesture, 0u);
    EXPECT_EQ(peer.session.pendingTransactions(), 0u);
    EXPECT_TRUE(peer.agrees());
}

}  // namespace
}  // namespace usdlive::client::sessiontest
