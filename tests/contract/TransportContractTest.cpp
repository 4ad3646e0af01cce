// Tests a server's Transport and a client's Connection together, over each of the transports.
#include <gtest/gtest.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <future>
#include <map>
#include <random>
#include <sstream>
#include <thread>

#include "transport/Connection.h"
#include "transport/DdsServer.h"
#include "transport/HttpServer.h"
#include "unit/common/protocol/SampleStates.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

using namespace usdlive;
using namespace usdlive::server;
using namespace std::chrono_literals;
using client::Connection;
using tests::presenceOf;
using tests::stateOf;
namespace asio = boost::asio;

namespace {

/// Makes a frame in its wire format: its length and at least 16 bytes.
SharedBytes frame(std::string text) {
    text.resize(std::max<std::size_t>(text.size(), 16), ' ');
    Bytes bytes;
    const auto size = std::uint32_t(text.size());
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(std::uint8_t(size >> shift));
    bytes.insert(bytes.end(), text.begin(), text.end());
    return std::make_shared<const Bytes>(std::move(bytes));
}

std::vector<std::string> textsOf(ByteView message) {
    std::vector<std::string> texts;
    const auto frames = splitMessage(message);
    if (!frames) return {"(broken)"};
    for (const ByteView part : *frames) {
        std::string text(asText(part));
        text.erase(text.find_last_not_of(' ') + 1);
        texts.push_back(std::move(text));
    }
    return texts;
}

class NoLog final : public Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override {}
};

enum class Kind { WebSocket, Dds };

/// A server whose handler notes its calls.
class World final : public SessionHandler {
public:
    explicit World(Kind kind, std::size_t slowReaderBytes = 16ull << 20) : kind_(kind) {
        const Background background = [this](auto job) { asio::post(workers_, std::move(job)); };
        if (kind == Kind::WebSocket) {
            WebSocketOptions options;
            options.slowReaderBytes = slowReaderBytes;
            options.maxHelloBytes = options.maxMessageBytes;  // there is no hello
            const auto sessions = createWebSocketTransport(io_, options, *this, background, log_);
            http_ = std::move(*createHttpServer(
                io_, {}, [sessions](auto) -> HttpRoute { return HttpSessions{sessions.get()}; },
                log_));
            address_ = {"127.0.0.1", http_->port(), ""};
            transport_ = sessions;
        } else {
            std::random_device device;
            settings_.domain = device() % 90;
            DdsServerOptions options;
            options.domain = settings_;
            options.project = "contract" + std::to_string(device());
            options.slowReaderBytes = slowReaderBytes;
            address_.dds = true;
            address_.project = options.project;
            transport_ = std::move(*createDdsServer(io_, options, *this, background, log_));
        }
        thread_ = std::thread([this] { io_.run(); });
    }

    /// Runs `function` on the network thread and waits for it.
    template <class Function>
    auto call(Function function) {
        std::packaged_task<decltype(function())()> task(std::move(function));
        auto result = task.get_future();
        asio::post(io_, [&task] { task(); });
        return result.get();
    }

    ~World() override {
        call([this] {
            http_.reset();
            transport_.reset();
        });
        work_.reset();
        io_.stop();
        thread_.join();
        workers_.join();
    }

    std::unique_ptr<Connection> connect() {
        ++connected_;
        if (kind_ == Kind::WebSocket) return client::createWebSocketConnection(address_);
        return std::move(*client::createDdsConnection(address_, settings_));
    }

    template <class Condition>
    bool waitFor(Condition condition) {
        for (const auto end = std::chrono::steady_clock::now() + 30s;
             std::chrono::steady_clock::now() < end; std::this_thread::sleep_for(1ms))
            if (call(condition)) return true;
        return false;
    }
    /// Waits until each connection made so far has a session: a client may know of it before the
    /// handler does.
    bool waitForSessions() {
        return waitFor([&] { return sessions.size() + ended.size() >= connected_; });
    }
    Transport& transport() { return *transport_; }

    // Used on the network thread only.
    std::vector<SessionId> sessions;  // the open ones
    std::map<SessionId, std::vector<std::string>> got;
    std::vector<SessionId> ended, drainedSessions;

private:
    void opened(SessionId session, const std::optional<SignedIn>&) override {
        sessions.push_back(session);
    }
    void received(SessionId session, ByteView message) override {
        for (std::string& text : textsOf(message)) got[session].push_back(std::move(text));
    }
    void closed(SessionId session) override {
        std::erase(sessions, session);
        ended.push_back(session);
    }
    void drained(SessionId session) override { drainedSessions.push_back(session); }

    const Kind kind_;
    std::size_t connected_ = 0;
    NoLog log_;
    asio::io_context io_{1};
    asio::executor_work_guard<asio::io_context::executor_type> work_ = asio::make_work_guard(io_);
    asio::thread_pool workers_{1};
    dds::DomainSettings settings_;
    client::ServerAddress address_;
    std::unique_ptr<HttpServer> http_;
    std::shared_ptr<Transport> transport_;
    std::thread thread_;
};

/// Collects the events of a connection, until `done`.
struct Inbox {
    std::vector<std::string> texts;
    int opened = 0, lost = 0;

    template <class Done>
    bool readUntil(Connection& connection, Done done, std::chrono::seconds time = 30s) {
        for (const auto end = std::chrono::steady_clock::now() + time;
             !done() && std::chrono::steady_clock::now() < end;) {
            if (!connection.wait(100ms)) continue;
            for (const auto& happening : connection.poll(16)) {
                opened += std::holds_alternative<Connection::Opened>(happening);
                lost += std::holds_alternative<Connection::Lost>(happening);
                if (const auto* message = std::get_if<Connection::Message>(&happening))
                    for (std::string& text : textsOf(*std::get<SharedBytes>(message->content)))
                        texts.push_back(std::move(text));
            }
        }
        return done();
    }
    bool read(Connection& connection, std::size_t count) {
        return readUntil(connection, [&] { return texts.size() >= count; });
    }
    bool open(Connection& connection, World& world) {
        return readUntil(connection, [before = opened, this] { return opened > before; }) &&
               world.waitForSessions();
    }
};

class TransportContract : public testing::TestWithParam<Kind> {};

std::string nameOf(const testing::TestParamInfo<Kind>& info) {
    return info.param == Kind::Dds ? "Dds" : "WebSocket";
}

INSTANTIATE_TEST_SUITE_P(All, TransportContract, testing::Values(Kind::WebSocket, Kind::Dds),
                         nameOf);

}  // namespace

TEST_P(TransportContract, CarriesBothWaysInOrder) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    for (int index = 0; index < 5'000; ++index) connection->send(frame(std::to_string(index)));
    ASSERT_TRUE(world.waitFor([&] {
        return world.sessions.size() == 1 && world.got[world.sessions[0]].size() == 5'000;
    }));
    world.call([&] {
        const auto& got = world.got[world.sessions[0]];
        for (int index = 0; index < 5'000; ++index) ASSERT_EQ(got[index], std::to_string(index));
        for (int index = 0; index < 5'000; ++index)
            world.transport().send(world.sessions[0], frame(std::to_string(index)));
    });
    ASSERT_TRUE(inbox.read(*connection, 5'000));
    for (int index = 0; index < 5'000; ++index)
        ASSERT_EQ(inbox.texts[index], std::to_string(index));
    EXPECT_TRUE(world.waitFor([&] { return world.transport().counters().queuedBytes == 0; }));
}

TEST_P(TransportContract, CarriesLargeMessages) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    const std::string large(12'345'678, 'x');
    connection->send(frame(large));
    ASSERT_TRUE(world.waitFor(
        [&] { return world.sessions.size() == 1 && world.got[world.sessions[0]].size() == 1; }));
    world.call([&] {
        EXPECT_EQ(world.got[world.sessions[0]][0], large);
        world.transport().send(world.sessions[0], frame(large));
        world.transport().send(world.sessions[0], frame("after"));
    });
    ASSERT_TRUE(inbox.read(*connection, 2));
    EXPECT_EQ(inbox.texts[0], large);
    EXPECT_EQ(inbox.texts[1], "after");
    EXPECT_EQ(connection->queuedBytes(), 0u);
}

TEST_P(TransportContract, BringsCommitsToAllInOrderWithTheRest) {
    World world(GetParam());
    constexpr int kClients = 3, kCommits = 500;
    std::vector<std::unique_ptr<Connection>> connections;
    std::vector<Inbox> inboxes(kClients);
    for (auto& inbox : inboxes) {
        connections.push_back(world.connect());
        ASSERT_TRUE(inbox.open(*connections.back(), world));
    }
    std::vector<std::string> expected;
    for (int index = 1; index <= kCommits; ++index) {
        const bool large = index % 100 == 0;
        expected.push_back("c" + std::to_string(index) + std::string(large ? 300'000 : 0, '+'));
        world.call([&] {
            world.transport().sendCommit(world.sessions, frame(expected.back()), Revision(index));
            if (index % 3 == 0)
                for (const SessionId session : world.sessions)
                    world.transport().send(session, frame("r" + std::to_string(index)));
        });
        if (index % 3 == 0) expected.push_back("r" + std::to_string(index));
    }
    for (int index = 0; index < kClients; ++index) {
        ASSERT_TRUE(inboxes[index].read(*connections[index], expected.size()));
        EXPECT_EQ(inboxes[index].texts, expected);
    }
}

namespace {

/// Two sessions that have been sent the commit c1.
struct TwoSessions {
    [[nodiscard]] bool open(World& world) {
        one = world.connect();
        if (!inbox.open(*one, world)) return false;
        other = world.connect();
        if (!ignored.open(*other, world)) return false;
        world.call([&] {
            both = world.sessions;
            world.transport().sendCommit(both, frame("c1"), 1);
        });
        return true;
    }

    std::unique_ptr<Connection> one, other;
    Inbox inbox, ignored;         // frames to one, frames to other
    std::vector<SessionId> both;  // in this order
};

}  // namespace

TEST_P(TransportContract, NoCommitIsSentWhileCommitsAreHeld) {
    World world(GetParam());
    TwoSessions two;
    ASSERT_TRUE(two.open(world));
    const SessionId first = two.both[0];
    const std::vector<SessionId> only{two.both[1]};
    world.call([&] {
        world.transport().holdCommits(first);
        world.transport().send(first, frame("begin"));
    });
    // The tested session has begun to read its log before the commit is sent.
    ASSERT_TRUE(two.inbox.read(*two.one, 2));
    world.call([&] { world.transport().sendCommit(only, frame("c2"), 2); });
    ASSERT_TRUE(two.ignored.read(*two.other, 2));
    world.call([&] {
        world.transport().send(first, frame("end"));
        world.transport().send(first, frame("c2 again"));
        world.transport().sendCommit(two.both, frame("c3"), 3);
    });
    ASSERT_TRUE(two.inbox.read(*two.one, 5));
    EXPECT_EQ(two.inbox.texts, (std::vector<std::string>{"c1", "begin", "end", "c2 again", "c3"}));
    ASSERT_TRUE(two.ignored.read(*two.other, 3));
    EXPECT_EQ(two.ignored.texts, (std::vector<std::string>{"c1", "c2", "c3"}));
}

// A preview that is sent before a hold would otherwise arrive after the commit that ends it.
TEST_P(TransportContract, NoCommitOvertakesWhatWasSentBeforeCommitsAreHeld) {
    World world(GetParam());
    TwoSessions two;
    ASSERT_TRUE(two.open(world));
    const SessionId first = two.both[0];
    const std::vector<SessionId> only{two.both[1]};
    ASSERT_TRUE(two.inbox.read(*two.one, 1));
    // In one turn, so that the commit is sent before the frames of the session.
    world.call([&] {
        world.transport().send(first, frame("before"));
        world.transport().holdCommits(first);
        world.transport().sendCommit(only, frame("c2"), 2);
    });
    ASSERT_TRUE(two.inbox.read(*two.one, 2));
    EXPECT_EQ(two.inbox.texts[1], "before");
}

namespace {

/// Returns the received states and presences in order, mixed with the commits: "c1 a.usda=3 ada=1
/// -bo".
std::string statesIn(const std::vector<std::string>& texts) {
    std::string states;
    for (const std::string& text : texts) {
        const auto frame = decodeFrame(asBytes(text));
        const auto* control = frame ? std::get_if<ControlFrame>(&*frame) : nullptr;
        const auto message = control ? decodeControl(control->json) : ControlMessage{};
        if (const auto* layers = control ? std::get_if<LayerStates>(&*message) : nullptr) {
            for (const LayerState& state : layers->layers)
                states += state.layer.value + "=" + std::to_string(state.saved) + " ";
        } else if (const auto* people = control ? std::get_if<Presences>(&*message) : nullptr) {
            for (const Presence& shown : people->shown)
                states += shown.client.value + "=" + std::to_string(int(*shown.time)) + " ";
            for (const ClientId& gone : people->gone) states += "-" + gone.value + " ";
        } else {
            states += text + " ";
        }
    }
    return states;
}

}  // namespace

TEST_P(TransportContract, UpdatesReachSessionsThatHaveTheInitialState) {
    World world(GetParam());
    const auto one = world.connect();
    const auto other = world.connect();
    Inbox inbox, otherInbox;
    ASSERT_TRUE(inbox.open(*one, world) && otherInbox.open(*other, world));
    const auto has = [&](const std::string& end) {
        return inbox.readUntil(*one, [&] { return statesIn(inbox.texts).ends_with(end); });
    };
    world.call([&] {
        // No session listens yet: sessions get this later, with their first states.
        world.transport().sendUpdate({}, LayerStates{{stateOf("a.usda", 1)}});
        world.transport().sendUpdate({}, Presences{{presenceOf("ada", 1)}, {}});
    });
    // Both are connected, but only one has asked for states and presences.
    std::vector<SessionId> listening;
    for (const SessionId session : world.call([&] { return world.sessions; })) {
        world.call([&] { world.transport().send(session, frame("hello")); });
        if (!inbox.texts.empty() || !listening.empty()) continue;
        if (inbox.readUntil(*one, [&] { return !inbox.texts.empty(); }, 1s))
            listening.push_back(session);
    }
    ASSERT_EQ(listening.size(), 1u);
    world.call([&] {
        world.transport().releaseCommits(listening[0], 1);
        world.transport().sendInitialState(listening[0], LayerStates{{stateOf("a.usda", 1)}});
        world.transport().sendInitialState(listening[0], Presences{{presenceOf("ada", 1)}, {}});
    });
    ASSERT_TRUE(has("hello a.usda=1 ada=1 "));
    world.call([&] {
        world.transport().sendUpdate(listening,
                                     LayerStates{{stateOf("a.usda", 2), stateOf("b.usda", 2)}});
    });
    ASSERT_TRUE(has("ada=1 a.usda=2 b.usda=2 "));
    world.call(
        [&] { world.transport().sendUpdate(listening, Presences{{presenceOf("bo", 7)}, {}}); });
    ASSERT_TRUE(has("b.usda=2 bo=7 "));
    world.call([&] { world.transport().sendUpdate(listening, Presences{{}, {{"bo"}}}); });
    ASSERT_TRUE(has("bo=7 -bo "));
    ASSERT_TRUE(otherInbox.read(*other, 1));
    EXPECT_EQ(statesIn(otherInbox.texts), "hello ");
}

TEST_P(TransportContract, LS1AStateFollowsItsCommit) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    world.call([&] { world.transport().sendInitialState(world.sessions[0], LayerStates{}); });
    constexpr int kCommits = 300;
    for (int index = 1; index <= kCommits; ++index)
        world.call([&] {
            const bool large = index % 50 == 0;
            world.transport().sendCommit(
                world.sessions,
                frame("c" + std::to_string(index) + std::string(large ? 100'000 : 0, '+')),
                Revision(index));
            world.transport().sendUpdate(
                world.sessions,
                LayerStates{{stateOf("l" + std::to_string(index % 3) + ".usda", Revision(index))}});
        });
    ASSERT_TRUE(inbox.readUntil(*connection, [&] {
        const std::string states = statesIn(inbox.texts);
        return states.find("c300") != std::string::npos &&
               states.find("=300 ") != std::string::npos &&
               states.find("=299 ") != std::string::npos &&
               states.find("=298 ") != std::string::npos;
    }));
    Revision reached = 0;
    std::map<std::string, Revision> latest;
    for (const std::string& text : inbox.texts) {
        const std::string states = statesIn({text});
        if (states.starts_with("c")) {
            reached = Revision(std::stoi(states.substr(1)));
            continue;
        }
        std::istringstream words(states);
        for (std::string word; words >> word;) {
            const Revision saved = Revision(std::stoi(word.substr(word.find('=') + 1)));
            ASSERT_LE(saved, reached);
            ASSERT_GT(saved, std::exchange(latest[word.substr(0, 2)], saved));
        }
    }
}

TEST_P(TransportContract, SourcesArriveCompleteBesideTheStream) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    constexpr int kParts = 100;
    world.call([&] {
        world.transport().sendBeside(
            world.sessions[0], [part = 0](std::size_t) mutable -> SharedBytes {
                if (part == kParts) return nullptr;
                return frame("part " + std::to_string(part++) + std::string(100'000, '.'));
            });
        world.transport().send(world.sessions[0], frame("stream"));
    });
    ASSERT_TRUE(inbox.read(*connection, kParts + 1));
    int part = 0;
    for (const std::string& text : inbox.texts) {
        if (text == "stream") continue;
        ASSERT_TRUE(text.starts_with("part " + std::to_string(part++) + "."));
    }
    EXPECT_EQ(part, kParts);
}

TEST_P(TransportContract, ACloseHasAReasonAndTheClientReconnects) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    world.call([&] {
        world.transport().send(world.sessions[0], frame("before"));
        world.transport().close(world.sessions[0], Error{ErrorCode::StaleBase, "too old"});
    });
    ASSERT_TRUE(inbox.readUntil(*connection, [&] { return inbox.opened == 2; }));
    ASSERT_EQ(inbox.texts.size(), 2u);
    EXPECT_EQ(inbox.texts[0], "before");
    EXPECT_NE(inbox.texts[1].find("too old"), std::string::npos);
    EXPECT_EQ(inbox.lost, 1);
    EXPECT_TRUE(world.waitFor([&] { return world.sessions.size() == 1; }));
    world.call([&] { EXPECT_EQ(world.ended.size(), 1u); });
}

TEST_P(TransportContract, AReleasedSessionEndsAtOnce) {
    World world(GetParam());
    auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    connection->send(frame("last words"));
    connection.reset();
    ASSERT_TRUE(world.waitFor([&] { return world.ended.size() == 1; }));
    world.call(
        [&] { EXPECT_EQ(world.got[world.ended[0]], std::vector<std::string>{"last words"}); });
}

TEST_P(TransportContract, AResetMakesANewSession) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    connection->reset();
    ASSERT_TRUE(inbox.readUntil(*connection, [&] { return inbox.opened == 2; }));
    ASSERT_TRUE(
        world.waitFor([&] { return world.ended.size() == 1 && world.sessions.size() == 1; }));
    connection->send(frame("new"));
    EXPECT_TRUE(world.waitFor([&] { return world.got[world.sessions[0]].size() == 1; }));
}

TEST_P(TransportContract, AClientThatIsNotReadWaits) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    const SessionId session = world.call([&] {
        world.transport().setReading(world.sessions[0], false);
        return world.sessions[0];
    });
    std::this_thread::sleep_for(20ms);  // a read may be in progress
    for (int index = 0; index < 200; ++index) connection->send(frame(std::string(100'000, 'x')));
    std::this_thread::sleep_for(500ms);
    world.call([&] { EXPECT_LT(world.got[session].size(), 200u); });
    EXPECT_GT(connection->queuedBytes(), 0u);
    world.call([&] { world.transport().setReading(session, true); });
    EXPECT_TRUE(world.waitFor([&] { return world.got[session].size() == 200; }));
}

TEST_P(TransportContract, CongestionAndItsEndAreReported) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    const bool congested = world.call([&] {
        for (int index = 0; index < 100; ++index)
            world.transport().send(world.sessions[0], frame(std::string(100'000, 'x')));
        return world.transport().congested(world.sessions[0]);
    });
    EXPECT_TRUE(congested);
    ASSERT_TRUE(inbox.read(*connection, 100));
    EXPECT_TRUE(world.waitFor([&] { return world.drainedSessions.size() == 1; }));
    world.call([&] { EXPECT_FALSE(world.transport().congested(world.sessions[0])); });
}

TEST_P(TransportContract, AClientWithTooMuchWaitingIsCut) {
    World world(GetParam(), 2 << 20);
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    world.call([&] {
        for (int index = 0; index < 100; ++index)
            world.transport().send(world.sessions[0], frame(std::string(100'000, 'x')));
        EXPECT_EQ(world.transport().counters().slowReaders, 1u);
    });
    ASSERT_TRUE(inbox.readUntil(*connection, [&] { return inbox.opened == 2; }));
    EXPECT_NE(inbox.texts.back().find("slowReader"), std::string::npos);
}

TEST_P(TransportContract, AStopNotifiesEverybodyAndEndsSoon) {
    World world(GetParam());
    const auto connection = world.connect();
    Inbox inbox;
    ASSERT_TRUE(inbox.open(*connection, world));
    const auto begin = std::chrono::steady_clock::now();
    std::promise<void> stopped;
    world.call([&] {
        world.transport().stop(Error{ErrorCode::ShuttingDown, "bye"}, 20s,
                               [&] { stopped.set_value(); });
    });
    ASSERT_TRUE(inbox.readUntil(*connection, [&] { return inbox.lost >= 1; }));
    EXPECT_EQ(stopped.get_future().wait_for(10s), std::future_status::ready);
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
    EXPECT_NE(inbox.texts.back().find("bye"), std::string::npos);
}

TEST_P(TransportContract, ManySessionsInOneProcess) {
    World world(GetParam());
    constexpr std::size_t kClients = 8;
    std::vector<std::unique_ptr<Connection>> connections;
    for (std::size_t index = 0; index < kClients; ++index) connections.push_back(world.connect());
    for (const auto& connection : connections) {
        Inbox inbox;
        ASSERT_TRUE(inbox.open(*connection, world));
    }
    EXPECT_TRUE(world.waitFor([&] { return world.sessions.size() == kClients; }));
    connections.clear();
    EXPECT_TRUE(world.waitFor([&] { return world.ended.size() == kClients; }));
}
