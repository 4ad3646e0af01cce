// Tests that a session sends nothing over which the server would end it: presences and requests
// with any values that a caller can choose.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "SessionPeer.h"
#include "unit/Seeds.h"
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::client::sessiontest {
namespace {

/// Fills the fields of a message with odd values, or with good ones.
class OddValues {
public:
    explicit OddValues(unsigned seed) : random_(seed) {}

    template <class Message>
        requires HasFields<Message>
    void fill(Message& message) {
        forEachField(message, [this](std::string_view, auto& field) { this->set(field); });
    }

private:
    std::size_t pick(std::size_t count) { return random_() % count; }

    template <class T>
    void set(std::optional<T>& value) {
        value.reset();
        if (pick(2) == 0) set(value.emplace());
    }
    template <class T>
    void set(std::vector<T>& values) {
        constexpr std::size_t kCounts[] = {0, 1, 2, 15, 16, 17, 3'000};
        values.resize(kCounts[pick(std::size(kCounts))]);
        for (T& value : values) set(value);
    }
    template <class T>
        requires HasFields<T>
    void set(T& message) {
        fill(message);
    }
    template <class Tag>
    void set(Id<Tag>& id) {
        set(id.value);
    }
    void set(Hash& hash) { hash = sha256(asBytes(std::to_string(random_()))); }
    void set(bool& value) { value = pick(2) == 0; }
    template <class T>
        requires std::is_integral_v<T>
    void set(T& value) {
        value = pick(2) == 0 ? T(pick(1'000)) : std::numeric_limits<T>::max();
    }
    void set(double& value) {
        using Limits = std::numeric_limits<double>;
        const double values[] = {0.0,
                                 1.5,
                                 -0.0,
                                 Limits::max(),
                                 Limits::min(),
                                 Limits::lowest(),
                                 Limits::infinity(),
                                 Limits::quiet_NaN()};
        value = values[pick(pick(4) == 0 ? std::size(values) : 6)];
    }
    void set(std::string& text) {
        using namespace std::string_literals;
        const std::string texts[] = {"shot.usda",
                                     "/World",
                                     "",
                                     "Zoë",
                                     "a\0b"s,
                                     "../x.usda",
                                     "{\"deep\":[[[[1]]]]}",
                                     std::string(300, 'x'),
                                     std::string(70'000, 'x'),
                                     "\xff\xfe not UTF-8",
                                     "\xed\xb2\x80"};
        text = texts[pick(pick(4) == 0 ? std::size(texts) : 5)];
    }

    std::mt19937 random_;
};

/// Returns whether the server would end the session over something that was sent.
bool isRefused(const std::deque<Frame>& sent) {
    for (const Frame& frame : sent) {
        const auto* control = std::get_if<ControlFrame>(&frame);
        const auto message = control ? decodeControl(control->json) : ControlMessage{};
        if (!message) return true;
        if (const auto* shown = std::get_if<ShowPresence>(&*message))
            if (!checkPresence(shown->presence)) return true;
    }
    return false;
}

struct PresenceTest : ::testing::Test {
    PresenceTest() {
        peer.features = protocolFeatures();
        peer.connectAndJoin();
        peer.sent.clear();
    }
    std::optional<Presence> sentNext() {
        for (int frame = 0; frame < 100; ++frame) peer.advance();
        const auto shown = peer.takeControl<ShowPresence>();
        peer.sent.clear();
        return shown ? std::optional(shown->presence) : std::nullopt;
    }
    /// The server ends the session. Its error may be read only when the connection is lost.
    void endBy(ErrorCode code, bool isReadLate) {
        ErrorMessage closing;
        closing.code = errorName(code);
        closing.closing = true;
        peer.deliver(closing);
        if (!isReadLate) peer.advance();
        peer.session.disconnected({code, "closed"});
        peer.connect();
        peer.sent.clear();
    }

    SessionPeer peer;
};

TEST_F(PresenceTest, PS1APresenceThatTheServerRefusesIsNotSent) {
    Presence good;
    good.selection = {"/World"};
    ASSERT_TRUE(peer.session.showPresence(good));
    std::vector<Presence> bad(6, good);
    bad[0].camera.assign(16, std::nan(""));
    bad[1].camera.assign(17, 1.0);
    bad[2].time = std::numeric_limits<double>::infinity();
    bad[3].data = "\xff";
    bad[4].data = std::string(65'500, ' ');
    bad[5].selection.assign(20'000, "/World/Props/crate");
    for (const Presence& presence : bad) {
        const auto shown = peer.session.showPresence(presence);
        ASSERT_FALSE(shown);
        EXPECT_FALSE(shown.error().message.empty());
    }
    EXPECT_EQ(sentNext(), good) << "what was shown before stays";
}

TEST_F(PresenceTest, PS1APresenceThatEndsTheSessionTwiceIsNotSentAgain) {
    Presence presence;
    presence.data = "a later server does not like it";
    ASSERT_TRUE(peer.session.showPresence(presence));
    bool isReadLate = false;
    for (const ErrorCode code :
         {ErrorCode::MalformedControl, ErrorCode::TooManySessions, ErrorCode::MalformedControl}) {
        EXPECT_EQ(sentNext(), presence);
        endBy(code, isReadLate = !isReadLate);
    }
    EXPECT_FALSE(sentNext());
    ASSERT_TRUE(peer.session.showPresence(presence));
    EXPECT_EQ(sentNext(), presence);
}

TEST_F(PresenceTest, NothingThatACallerChoosesEndsTheSession) {
    for (unsigned seed = 0; seed < seedsOf(400); ++seed) {
        SCOPED_TRACE(seed);
        OddValues odd(seed);
        Presence presence;
        odd.fill(presence);
        static_cast<void>(peer.session.showPresence(presence));
        std::size_t requests = 0;
        forEachRequest([&](auto request) {
            odd.fill(request);
            static_cast<void>(peer.session.request(std::move(request)));
            ++requests;
        });
        for (int frame = 0; frame < 4; ++frame) peer.advance();
        EXPECT_FALSE(isRefused(peer.sent));
        const auto refused = peer.eventsOf<event::ServerError>().size();
        const auto sent = std::ranges::count_if(peer.sent, [](const Frame& frame) {
            const auto* control = std::get_if<ControlFrame>(&frame);
            return control && !std::holds_alternative<ShowPresence>(*decodeControl(control->json));
        });
        EXPECT_EQ(refused + std::size_t(sent), requests) << "each is sent or refused";
        peer.sent.clear();
        peer.events.clear();
    }
}

}  // namespace
}  // namespace usdlive::client::sessiontest
