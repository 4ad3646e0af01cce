// Connects to a server over DDS.
#include <algorithm>
#include <atomic>
#include <mutex>
#include <thread>

#include "transport/CommitOrder.h"
#include "transport/DdsProjects.h"
#include "transport/MailboxConnection.h"
#include "transport/RetryDelay.h"
#include "transport/StateOrder.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/dds/SegmentReceiver.h"
#include "usdlive/common/dds/SegmentSender.h"
#include "usdlive/common/dds/StateSamples.h"
#include "usdlive/common/dds/Topics.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::client {

namespace {

using dds::TimePoint;
using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

constexpr auto kConnectTimeout = seconds(5);
// A server sends a sign of life every 2 s.
constexpr auto kPeerTime = seconds(14);
constexpr auto kKeepAlive = seconds(2);
// The grace time for a server that DDS reports as lost. On a busy machine it may only be late.
constexpr auto kLostTime = seconds(3);
// The pause between attempts until the server answers the first sample, which it may not have
// received.
constexpr auto kAskPause = milliseconds(20);
// The time limit for sending the queue and the goodbye of a destroyed connection.
constexpr auto kGoodbye = milliseconds(500);
// A message of the server has one or more frames. The extra space is for those beside the largest.
constexpr std::size_t kMaxMessageBytes = kMaxFrameBytes + 8 * 1024 * 1024;
// The pause between looks at the addresses of the network interface.
constexpr auto kLookPause = seconds(1);
// A participant without a session for so long is replaced, in case that it is deaf: a change of the
// network that does not show in the addresses.
constexpr auto kDeafTime = seconds(30);
constexpr auto kReplacePause = milliseconds(50);
// The limit of data that is taken from the mailbox in advance.
constexpr std::size_t kWaitingBytes = 1024 * 1024;

std::uint64_t positionOf(const dds::CommitSample& sample, std::uint64_t client) {
    for (std::uint32_t index = 0; index < sample.marks._length; ++index)
        if (sample.marks._buffer[index].client == client)
            return sample.marks._buffer[index].position;
    return 0;
}

template <class Sample>
dds::Segment segmentOf(const Sample& sample) {
    dds::Segment segment;
    segment.sequence = sample.number;
    segment.more = (sample.flags & dds::kMore) != 0;
    segment.end = (sample.flags & dds::kEnd) != 0;
    segment.owner = dds::copyOf(sample.frames);
    segment.bytes = *segment.owner;
    return segment;
}

SharedBytes encoded(const ControlMessage& message) {
    return std::make_shared<const Bytes>(encodeFrame(ControlFrame{encodeControl(message)}));
}

/// Returns the presences of a message that contains nothing else; none for other messages.
Presences presencesIn(const SharedBytes& message) {
    const auto frames = message ? splitMessage(*message) : std::vector<ByteView>{};
    if (!frames || frames->empty()) return {};
    const auto frame = decodeFrame(frames->front());
    const auto* control = frame ? std::get_if<ControlFrame>(&*frame) : nullptr;
    const auto decoded = control ? decodeControl(control->json) : ControlMessage{};
    const auto* presences = decoded ? std::get_if<Presences>(&*decoded) : nullptr;
    return presences ? *presences : Presences{};
}

/// One connection from its first sample to its end. Belongs to the connection's thread.
class Line {
public:
    /// `participant` is the server's. Samples of others in its name are ignored (DD13).
    Line(const dds::Domain& domain, dds::WaitSet& waitSet, Mailbox& mailbox, std::uint64_t server,
         const dds::ParticipantId& participant, std::uint64_t client, std::uint64_t connection)
        : mailbox_(mailbox),
          client_(client),
          connection_(connection),
          server_(server),
          participant_(participant),
          commits_(domain, dds::partitionOf(server)),
          replies_(domain, dds::partitionOf(server, client)),
          beside_(domain, dds::partitionOf(server, client)),
          states_(domain, dds::partitionOf(server)),
          presences_(domain, dds::partitionOf(server)),
          writer_(domain, dds::submitPartitionOf(server, domain.identity())),
          order_(kMaxMessageBytes),
          besideIn_(kMaxMessageBytes) {
        for (const dds_entity_t reader :
             {commits_.get(), replies_.get(), beside_.get(), states_.get(), presences_.get()})
            waitSet.attach(reader);
    }

    [[nodiscard]] std::uint64_t server() const { return server_; }
    /// The generation in the mailbox; 0: the server has not answered.
    [[nodiscard]] std::uint64_t generation() const { return generation_; }
    [[nodiscard]] const std::optional<Error>& reason() const { return reason_; }
    /// Ends the connection. Only the first reason is kept.
    void end(std::string message) {
        if (!reason_) reason_ = Error{ErrorCode::NotConnected, std::move(message)};
    }

    /// Call when DDS reports that the server is lost. `replaced`: another server has taken its
    /// place.
    void serverLost(TimePoint now, bool replaced) {
        if (replaced || now - lastReceived_ >= kLostTime) end("the server has gone");
    }

    /// Sends only the queued messages from now on, then the goodbye.
    void leave(TimePoint now) {
        if (generation_ == 0) return end("left");
        queue(true);
        out_.pushEnd();
        leaveBy_ = now + kGoodbye;
    }

    /// Processes received samples and writes everything that is due.
    void work(TimePoint now) {
        takeReplies(now);
        takeBeside(now);
        takeCommits();
        takeStateUpdates(now);
        deliver(now);
        if (now - lastReceived_ >=
            (generation_ == 0 ? seconds(kConnectTimeout) : seconds(kPeerTime)))
            end("the server does not answer");
        if (leaveBy_ && (out_.isEmpty() || now >= *leaveBy_)) end("left");
        if (reason_) return acknowledgeGoodbye(now);
        if (generation_ == 0) return ask(now);
        queue(false);
        sendDue(now);
    }

    /// Returns the time when work() is due even if nothing is received.
    [[nodiscard]] TimePoint deadline() const {
        TimePoint earliest = lastSent_ + (generation_ == 0 ? milliseconds(kAskPause) : kKeepAlive);
        for (const auto& due : {out_.deadline(), order_.deadline(), leaveBy_, order_.ackDue(),
                                besideIn_.ackDue(), stateOrder_.deadline()})
            if (due) earliest = std::min(earliest, *due);
        return earliest;
    }

private:
    // --- Receiving

    template <class Sample>
    [[nodiscard]] bool isOurs(const Sample& sample, const dds::SampleInfo& info) const {
        return info.isOf(participant_) && sample.connection == connection_;
    }

    void takeReplies(TimePoint now) {
        replies_.take([&](const dds::ReplySample& sample, const dds::SampleInfo& info) {
            if (!isOurs(sample, info)) return;
            lastReceived_ = now;
            if (generation_ == 0) generation_ = mailbox_.opened();
            if (out_.acknowledged(sample.ackSubmit, now)) noteAcknowledged();
            order_.sent(sample.afterCommit);
            if (sample.resent != 0)
                return order_.commit(sample.resent, sample.mark, dds::copyOf(sample.frames));
            if (sample.number == 0) {
                if ((sample.flags & dds::kEnd) != 0) end("the server has ended the session");
                return;
            }
            dds::Segment segment = segmentOf(sample);
            segment.mark = {sample.afterCommit, (sample.flags & dds::kHold) != 0, sample.liveFrom,
                            sample.statesFrom, sample.presencesFrom};
            order_.replies().received(std::move(segment), now);
        });
    }

    void takeBeside(TimePoint now) {
        beside_.take([&](const dds::BesideSample& sample, const dds::SampleInfo& info) {
            if (!isOurs(sample, info) || sample.number == 0) return;
            lastReceived_ = now;
            besideIn_.received(segmentOf(sample), now);
        });
    }

    void takeCommits() {
        commits_.take([&](const dds::CommitSample& sample, const dds::SampleInfo& info) {
            if (!info.isOf(participant_)) return;
            order_.commit(sample.revision, positionOf(sample, client_), dds::copyOf(sample.frame));
        });
    }

    void takeStateUpdates(TimePoint now) {
        states_.take([&](const dds::LayerStateSample& sample, const dds::SampleInfo& info) {
            if (!info.alive || !info.isOf(participant_) || sample.server != server_) return;
            if (auto state = dds::layerStateOf(sample))
                stateOrder_.state(sample.number, sample.afterCommit, std::move(*state));
        });
        presences_.take([&](const dds::PresenceSample& sample, const dds::SampleInfo& info) {
            if (!info.isOf(participant_) || sample.server != server_) return;
            if (!info.alive) return stateOrder_.gone({sample.client ? sample.client : ""});
            if (auto presence = dds::presenceOf(sample))
                stateOrder_.presence(sample.number, std::move(*presence), now);
        });
    }

    void deliver(TimePoint now) {
        while (const auto message = order_.take(now)) {
            deliver(message->bytes);
            if (message->mark.statesFrom != 0) stateOrder_.statesFrom(message->mark.statesFrom);
            if (message->mark.presencesFrom != 0)
                stateOrder_.presencesFrom(message->mark.presencesFrom, presencesIn(message->bytes),
                                          now);
            if (message->end) end("the server has closed the session");
        }
        while (const auto message = besideIn_.take(now)) deliver(message->bytes);
        if (auto states = stateOrder_.takeStates(order_); !states.layers.empty())
            deliver(encoded(std::move(states)));
        if (auto people = stateOrder_.takePresences(now);
            !people.shown.empty() || !people.gone.empty())
            deliver(encoded(std::move(people)));
        if (order_.replies().isTooLarge() || besideIn_.isTooLarge())
            end("the server sent a message that is too large");
    }

    void deliver(const SharedBytes& bytes) {
        if (!bytes || bytes->empty()) return;
        // The session resumes later with the messages that were not fetched.
        if (!mailbox_.message(bytes)) end("too many received messages were not fetched");
    }

    // --- Sending

    void queue(bool all) {
        while (all || out_.waitingBytes() < kWaitingBytes) {
            const auto batch = mailbox_.takeBatch();
            if (batch.empty()) return;
            for (const SharedBytes& frames : batch) {
                pushed_ += frames->size();
                mailbox_.written(frames->size());
                out_.push(frames);
            }
            static_cast<void>(mailbox_.mark());
        }
    }

    void noteAcknowledged() { mailbox_.acknowledged(pushed_ - out_.queuedBytes()); }

    void ask(TimePoint now) {
        if (now < lastSent_ + kAskPause) return;
        dds::SubmitSample sample{};
        sample.flags = dds::kAnswer;
        write(sample, now);
    }

    void sendDue(TimePoint now) {
        for (const dds::Segment& segment : out_.take(now)) {
            dds::SubmitSample sample{};
            sample.number = segment.sequence;
            sample.flags =
                std::uint8_t((segment.more ? dds::kMore : 0) | (segment.end ? dds::kEnd : 0));
            sample.frames = dds::octets(segment.bytes);
            write(sample, now);
        }
        const auto missing = order_.nextRequest(now);
        const auto isDue = [now](const std::optional<TimePoint>& due) {
            return due && now >= *due;
        };
        if (!missing && !isDue(order_.replies().ackDue()) && !isDue(besideIn_.ackDue()) &&
            now < lastSent_ + kKeepAlive)
            return;
        dds::SubmitSample sample{};
        if (missing) {
            sample.resendFrom = missing->from;
            sample.resendTo = missing->to;
        }
        write(sample, now);
    }

    // A server that closes the session waits for this.
    void acknowledgeGoodbye(TimePoint now) {
        if (!order_.ackDue()) return;
        dds::SubmitSample sample{};
        write(sample, now);
    }

    void write(dds::SubmitSample& sample, TimePoint now) {
        sample.client = client_;
        sample.connection = connection_;
        sample.protocol = dds::kDdsProtocol;
        sample.ackReply = order_.replies().taken();
        sample.ackBeside = besideIn_.taken();
        order_.replies().ackSent();
        besideIn_.ackSent();
        lastSent_ = now;
        // A sample that DDS does not accept is sent again like an unacknowledged one.
        static_cast<void>(writer_.write(sample));
    }

    Mailbox& mailbox_;
    const std::uint64_t client_, connection_, server_;
    const dds::ParticipantId participant_;
    dds::Reader<dds::CommitSample> commits_;
    dds::Reader<dds::ReplySample> replies_;
    dds::Reader<dds::BesideSample> beside_;
    dds::Reader<dds::LayerStateSample> states_;
    dds::Reader<dds::PresenceSample> presences_;
    dds::Writer<dds::SubmitSample> writer_;

    CommitOrder order_;
    StateOrder stateOrder_;
    dds::SegmentReceiver besideIn_;
    dds::SegmentSender out_;
    std::uint64_t pushed_ = 0;  // bytes of the mailbox's messages
    std::uint64_t generation_ = 0;
    std::optional<Error> reason_;
    TimePoint lastReceived_ = steady_clock::now();
    TimePoint lastSent_;
    std::optional<TimePoint> leaveBy_;
};

class DdsConnection final : public MailboxConnection {
public:
    DdsConnection(const ServerAddress& address, const dds::DomainSettings& settings,
                  std::unique_ptr<dds::Domain> domain, Brings brings)
        : MailboxConnection(address, brings),
          settings_(settings),
          node_(std::make_shared<Node>(settings, std::move(domain))) {
        thread_ = startThread("usdlive dds", [this] { run(); });
    }

    ~DdsConnection() override {
        leaving_ = true;
        wake();
        thread_.join();
    }

    std::optional<ServerAddress> web() const override {
        const std::lock_guard lock(projectMutex_);
        return web_;
    }
    void prefer(const StoreId& store) override {
        const std::lock_guard lock(projectMutex_);
        preferred_ = store;
    }

private:
    /// A participant, and what belongs to it. A participant keeps the addresses that its interface
    /// had when it was created, so it is replaced when they change.
    struct Node {
        Node(const dds::DomainSettings& settings, std::unique_ptr<dds::Domain> made)
            : domain(std::move(made)),
              addresses(dds::addressesOf(settings)),
              projects(*domain),
              waitSet(*domain) {
            waitSet.attach(projects.reader());
        }
        const std::unique_ptr<dds::Domain> domain;
        const std::string addresses;
        bool hadNone = false;                   ///< the interface lost its addresses
        TimePoint heard = steady_clock::now();  ///< a session was open, or the node was created
        const std::uint64_t client = dds::randomNumber();
        std::uint64_t connections = 0;
        DdsProjects projects;
        dds::WaitSet waitSet;
    };

    void queued() override { wake(); }
    void madeRoom() override { wake(); }

    void wake() {
        const std::lock_guard lock(nodeMutex_);
        if (node_) node_->waitSet.wake();
    }

    void drop(std::uint64_t generation, std::string why) override {
        {
            const std::lock_guard lock(dropMutex_);
            drop_ = {generation, std::move(why)};
        }
        wake();
    }

    void run() {
        RetryDelay delay;
        while (!leaving_) {
            const TimePoint start = steady_clock::now();
            Error reason = attempt();
            if (leaving_) return;
            mailbox_.lost(std::move(reason));
            if (isOutdated()) replaceNode();
            rest(delay.next(steady_clock::now() - start));
            while (!leaving_ && !mailbox_.hasRoom()) rest(RetryDelay::kLongest);
        }
    }

    void rest(milliseconds time) {
        const TimePoint end = steady_clock::now() + time;
        for (TimePoint now = steady_clock::now(); now < end && !leaving_;
             now = steady_clock::now()) {
            node_->waitSet.wait(end - now);
            node_->projects.update();
        }
    }

    // --- The participant

    /// Returns why the participant cannot hear others any more, if that is so.
    std::optional<std::string> otherAddress() {
        const std::string now = dds::addressesOf(settings_);
        if (now.empty()) node_->hadNone = true;
        if (now.empty() || (now == node_->addresses && !node_->hadNone)) return std::nullopt;
        return "the address of this machine has changed to " + now +
               (now == node_->addresses ? std::string() : ", from " + node_->addresses);
    }
    bool isOutdated() { return otherAddress() || steady_clock::now() - node_->heard >= kDeafTime; }

    /// Deletes the participant first: a domain that has a name exists once in a process.
    void replaceNode() {
        setNode(nullptr);
        while (!leaving_) {
            auto domain = dds::createDomain(settings_);
            try {
                if (domain) return setNode(std::make_shared<Node>(settings_, std::move(*domain)));
                mailbox_.lost(domain.error());
            } catch (const std::runtime_error& fault) {
                mailbox_.lost({ErrorCode::NotConnected, fault.what()});
            }
            for (const TimePoint end = steady_clock::now() + RetryDelay::kLongest;
                 steady_clock::now() < end && !leaving_;)
                std::this_thread::sleep_for(kReplacePause);
        }
    }
    void setNode(std::shared_ptr<Node> node) {
        const std::lock_guard lock(nodeMutex_);
        node_.swap(node);
    }

    // Connects and works until the connection is lost. Returns the reason.
    Error attempt() {
        try {
            const auto server = findServer();
            if (!server)
                return {ErrorCode::NotConnected,
                        "no server of " + where() + " was found in DDS domain " +
                            std::to_string(settings_.domain) + " on " + settings_.interface};
            learnWeb(*server);
            Line line(*node_->domain, node_->waitSet, mailbox_, *server,
                      node_->projects.participantOf(*server), node_->client, ++node_->connections);
            return use(line);
        } catch (const std::runtime_error& fault) {
            return {ErrorCode::NotConnected, fault.what()};
        }
    }

    /// The announcement names the server's WebSocket address, at which it also answers HTTP.
    void learnWeb(std::uint64_t server) {
        const auto found = parseServerAddress(node_->projects.urlOf(server));
        const std::lock_guard lock(projectMutex_);
        web_ = found && !found->dds ? std::optional(*found) : std::nullopt;
    }

    [[nodiscard]] std::optional<std::uint64_t> bestServer() const {
        const std::lock_guard lock(projectMutex_);
        return node_->projects.serverOf(address_.project, preferred_);
    }

    std::optional<std::uint64_t> findServer() {
        const TimePoint end = steady_clock::now() + kConnectTimeout;
        for (TimePoint now = steady_clock::now(); now < end && !leaving_;
             now = steady_clock::now()) {
            node_->projects.update();
            if (const auto server = bestServer()) return server;
            node_->waitSet.wait(end - now);
        }
        return std::nullopt;
    }

    Error use(Line& line) {
        bool left = false;
        TimePoint looked = steady_clock::now();
        while (!line.reason()) {
            const TimePoint now = steady_clock::now();
            if (leaving_ && !std::exchange(left, true)) line.leave(now);
            node_->projects.update();
            endDropped(line);
            line.work(now);
            if (line.generation() != 0) node_->heard = now;
            if (!node_->projects.isAlive(line.server()))
                line.serverLost(now, bestServer().has_value());
            if (now - looked >= kLookPause) {
                looked = now;
                if (auto why = otherAddress()) line.end(*std::move(why));
            }
            const TimePoint next = std::min(line.deadline(), looked + kLookPause);
            if (!line.reason()) node_->waitSet.wait(next - steady_clock::now());
        }
        return lost(line.reason()->message);
    }

    void endDropped(Line& line) {
        const std::lock_guard lock(dropMutex_);
        if (drop_ && drop_->generation == line.generation()) line.end(drop_->message);
        drop_.reset();
    }

    struct Drop {
        std::uint64_t generation = 0;
        std::string message;
    };

    const dds::DomainSettings settings_;
    std::mutex nodeMutex_;  // guards the pointer; only the connection's thread changes it
    std::shared_ptr<Node> node_;
    mutable std::mutex projectMutex_;  // guards the next two
    std::optional<ServerAddress> web_;
    StoreId preferred_;
    std::mutex dropMutex_;
    std::optional<Drop> drop_;
    std::atomic<bool> leaving_ = false;
    std::thread thread_;
};

}  // namespace

Result<std::unique_ptr<Connection>> createDdsConnection(const ServerAddress& address,
                                                        const dds::DomainSettings& settings,
                                                        Connection::Brings brings) {
    auto domain = dds::createDomain(settings);
    if (!domain) return tl::unexpected(domain.error());
    try {
        return std::make_unique<DdsConnection>(address, settings, std::move(*domain), brings);
    } catch (const std::runtime_error& fault) {
        return fail(ErrorCode::InvalidConfiguration, fault.what());
    }
}

}  // namespace usdlive::client
