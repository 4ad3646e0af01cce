// Serves the sessions of one project over DDS.
#include "transport/DdsServer.h"

#include <algorithm>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "transport/DdsSession.h"
#include "transport/DdsStatePublisher.h"
#include "transport/WhileAlive.h"
#include "usdlive/common/core/Budget.h"
#include "usdlive/common/core/Overloaded.h"
#include "usdlive/common/core/Thread.h"
#include "usdlive/common/dds/Topics.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
using dds::TimePoint;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// A larger commit is sent to each session individually, in pieces and at the reader's own pace.
// Together with the writer's depth this limits the memory of Cyclone DDS for slow readers.
constexpr std::size_t kBroadcastBytes = 64 * 1024;
constexpr milliseconds kSweep{250};
constexpr milliseconds kStoppingSweep{20};
// Sessions are checked when one has something to do, but not more often than this.
constexpr milliseconds kLeastPause{5};
// Pauses between announcements: after a new revision, and without one, for clients that considered
// the server lost.
constexpr milliseconds kAnnouncePause{1'000};
constexpr milliseconds kAnnounceAnyway{2'000};
// The DDS thread sleeps until samples arrive, at most this long.
constexpr std::chrono::seconds kWait{10};
constexpr milliseconds kReportPause{100};
// A participant opens at most this many sessions in this time.
constexpr std::uint64_t kMostOpened = 16;
constexpr std::chrono::seconds kOpenPause{1};

Submit copyOf(const dds::SubmitSample& sample, const dds::SampleInfo& info) {
    Submit submit;
    submit.participant = info.participant;
    submit.user = info.user;
    submit.protocol = sample.protocol;
    submit.client = sample.client;
    submit.connection = sample.connection;
    submit.ackReply = sample.ackReply;
    submit.ackBeside = sample.ackBeside;
    submit.resendFrom = sample.resendFrom;
    submit.resendTo = sample.resendTo;
    submit.answer = (sample.flags & dds::kAnswer) != 0;
    submit.segment.sequence = sample.number;
    submit.segment.more = (sample.flags & dds::kMore) != 0;
    submit.segment.end = (sample.flags & dds::kEnd) != 0;
    submit.isTooLarge = sample.frames._length > dds::kSegmentBytes;
    if (submit.isTooLarge) return submit;
    submit.segment.owner = dds::copyOf(sample.frames);
    submit.segment.bytes = *submit.segment.owner;
    return submit;
}

/// The samples that wait for the network thread, by participant (DD16). Any thread.
class WaitingSamples {
public:
    /// A client has at most one window of 4 MiB on its way.
    static constexpr std::size_t kEach = 8u << 20;
    static constexpr std::size_t kAll = 64u << 20;

    /// Returns false if too much of the participant, or of all, waits already.
    bool add(const Submit& submit) {
        const std::lock_guard lock(mutex_);
        const std::size_t bytes = bytesOf(submit);
        if (bytes_.of(submit.participant) + bytes > kEach || bytes_.used() + bytes > kAll)
            return false;
        bytes_.take(submit.participant, bytes);
        return true;
    }
    void remove(const Submit& submit) {
        const std::lock_guard lock(mutex_);
        bytes_.giveBack(submit.participant, bytesOf(submit));
    }
    [[nodiscard]] bool isEmpty() const {
        const std::lock_guard lock(mutex_);
        return bytes_.used() == 0;
    }

private:
    static std::size_t bytesOf(const Submit& submit) {
        return sizeof(Submit) + (submit.isTooLarge ? 0 : submit.segment.bytes.size());
    }

    mutable std::mutex mutex_;
    Budget<dds::ParticipantId> bytes_;
};

/// Samples that were received at once, and the numbers of those that were not kept.
struct Received {
    std::vector<Submit> submits;
    std::map<dds::ParticipantId, std::uint64_t> dropped;
};

/// Receives the samples of clients on its own thread. Takes them from DDS at once, however busy the
/// network thread is, because there they would take memory without a bound.
class SubmitThread {
public:
    using Take = std::function<void(Received)>;

    SubmitThread(const dds::Domain& domain, std::uint64_t server, WaitingSamples& waiting,
                 Take take)
        : reader_(domain, dds::submitPartitionsOf(server)),
          waitSet_(domain),
          waiting_(waiting),
          take_(std::move(take)) {
        waitSet_.attach(reader_.get());
        thread_ = startThread("dds submits", [this] { run(); });
    }
    ~SubmitThread() {
        leaving_ = true;
        waitSet_.wake();
        thread_.join();
    }

private:
    void run() {
        Received received;
        const auto keep = [&](const dds::SubmitSample& sample, const dds::SampleInfo& info) {
            Submit submit = copyOf(sample, info);
            if (waiting_.add(submit))
                received.submits.push_back(std::move(submit));
            else
                ++received.dropped[info.participant];
        };
        while (!leaving_) {
            const bool more = reader_.takeSome(keep);
            // Reports what was dropped with the next samples, or when nothing waits any more.
            if (!received.submits.empty() || (!received.dropped.empty() && waiting_.isEmpty()))
                take_(std::exchange(received, {}));
            if (!more) waitSet_.wait(received.dropped.empty() ? kWait : kReportPause);
        }
    }

    dds::Reader<dds::SubmitSample> reader_;
    dds::WaitSet waitSet_;
    WaitingSamples& waiting_;
    const Take take_;
    std::atomic<bool> leaving_ = false;
    std::thread thread_;
};

class DdsTransport final : public Transport, public DdsHub {
public:
    DdsTransport(asio::io_context& io, DdsServerOptions options, SessionHandler& handler,
                 Background background, Log& log, std::unique_ptr<dds::Domain> made)
        : DdsHub(io, std::move(options), handler, std::move(background), log, std::move(made),
                 dds::randomNumber()),
          lastSession_(sessionsOf(Carrier::Dds)),
          revision_(this->options.revision),
          started_(std::chrono::duration_cast<milliseconds>(
                       std::chrono::system_clock::now().time_since_epoch())
                       .count()),
          projectWriter_(*domain, ""),
          commitWriter_(*domain, dds::partitionOf(server)),
          statePublisher_(*domain, server),
          timer_(io),
          submitThread_(*domain, server, waiting_, [this](Received samples) {
              asio::post(this->io,
                         whileAlive(life_, [this, samples = std::move(samples)]() mutable {
                             take(std::move(samples));
                         }));
          }) {
        announce();
        wakeBy(steady_clock::now() + kSweep);
    }

    ~DdsTransport() override {
        // Disposed last, because clients treat it as the end and ignore everything that follows.
        projectWriter_.dispose(projectSample());
    }

    const TransportCounters& counters() const override {
        counters_ = DdsHub::counters;
        counters_.connections = sessions_.size();
        counters_.ignored = ignored_.counts();
        for (const auto& [id, session] : sessions_) counters_.queuedBytes += session->queuedBytes();
        return counters_;
    }

    void send(SessionId session, SharedBytes frames) override {
        if (const auto found = find(session)) found->send(std::move(frames));
    }

    void sendCommit(std::span<const SessionId> sessions, SharedBytes frame,
                    Revision revision) override {
        revision_ = revision;
        if (frame->size() > kBroadcastBytes) {
            commits.add(revision, {});
            for (const SessionId id : sessions)
                if (const auto session = find(id)) session->sendCommit(frame, revision);
            return;
        }
        for (const SessionId id : sessions)
            if (const auto session = find(id)) session->commitSent(revision);
        std::vector<SentCommits::Mark> marks;
        for (const auto& [id, session] : sessions_)
            if (const auto mark = session->mark()) marks.push_back(*mark);
        write(revision, *frame, marks);
        commits.add(revision, {std::move(frame), std::move(marks)});
    }

    bool holdCommits(SessionId session) override {
        if (const auto found = find(session)) found->holdCommits();
        return true;
    }
    void releaseCommits(SessionId session, Revision next) override {
        if (const auto found = find(session)) found->releaseCommits(next);
    }
    void sendUpdate(std::span<const SessionId>, const StateUpdate& update) override {
        std::visit(
            Overloaded{
                [&](const LayerStates& states) { statePublisher_.publish(states, revision_); },
                [&](const Presences& people) {
                    statePublisher_.publish(people, steady_clock::now());
                },
            },
            update);
        ++DdsHub::counters.framesOut;
    }
    void sendInitialState(SessionId session, const StateUpdate& all) override {
        const bool states = std::holds_alternative<LayerStates>(all);
        if (const auto found = find(session))
            found->sendFirst(encodeStateUpdate(all), states ? statePublisher_.next() : 0,
                             states ? 0 : statePublisher_.next());
    }
    bool congested(SessionId session) override {
        const auto found = find(session);
        return found && found->congested();
    }
    bool lags(SessionId) override { return false; }  // commits are sent once for all sessions
    void sendBeside(SessionId session, FrameSource source) override {
        if (const auto found = find(session)) found->sendBeside(std::move(source));
    }
    void close(SessionId session) override {
        if (const auto found = find(session)) found->close(std::nullopt);
    }
    void close(SessionId session, const Error& why) override {
        if (const auto found = find(session)) found->close(why);
    }
    void closeAll(const Error& why) override {
        for (const auto& session : all()) session->close(why);
        statePublisher_.clear();
    }
    void setReading(SessionId session, bool reading) override {
        if (const auto found = find(session)) found->setReading(reading);
    }

    void stop(const Error& why, milliseconds time, std::function<void()> done) override {
        stopped_ = std::move(done);
        stopDeadline_ = steady_clock::now() + time;
        closeAll(why);
        wakeBy(steady_clock::now() + kStoppingSweep);
        notifyStopped();
    }

    Carrier carrier() const override { return Carrier::Dds; }

    // Implements DdsHub.
    void flushLater(std::shared_ptr<DdsSession> session) override {
        toFlush_.push_back(std::move(session));
        if (toFlush_.size() > 1) return;
        asio::post(io, whileAlive(life_, [this] { flush(); }));
    }

    void ignored(IgnoreReason reason, const Submit& submit) override {
        ignored(reason, submit.participant, 1);
    }

    void finished(DdsSession& session) override {
        // The session is still executing. It is destroyed after this turn of the event loop.
        const auto entry = sessions_.find(session.id());
        closed_.push_back(std::move(entry->second));
        asio::post(io, whileAlive(life_, [this] { closed_.clear(); }));
        sessions_.erase(entry);
        const auto client = clients_.find(session.client());
        if (client != clients_.end() && client->second == session.id()) clients_.erase(client);
        notifyStopped();
    }

private:
    [[nodiscard]] std::shared_ptr<DdsSession> find(SessionId id) const {
        const auto entry = sessions_.find(id);
        return entry == sessions_.end() ? nullptr : entry->second;
    }

    [[nodiscard]] std::vector<std::shared_ptr<DdsSession>> all() const {
        std::vector<std::shared_ptr<DdsSession>> sessions;
        for (const auto& [id, session] : sessions_) sessions.push_back(session);
        return sessions;
    }

    // --- Receiving

    void ignored(IgnoreReason reason, const dds::ParticipantId& participant,
                 std::uint64_t samples) {
        if (!ignored_.add(reason, participant, samples)) return;
        log.write(LogLevel::Warning, "samples ignored",
                  {{"from", dds::textOf(participant)}, {"reason", nameOf(reason)}});
    }

    void take(Received samples) {
        for (Submit& submit : samples.submits) {
            waiting_.remove(submit);
            received(std::move(submit));
        }
        for (const auto& [participant, count] : samples.dropped)
            ignored(IgnoreReason::TooMany, participant, count);
    }

    void received(Submit submit) {
        if (const auto reason = ignoreReasonOf(submit)) return ignored(*reason, submit);
        if (const auto session = sessionOf(submit)) session->received(std::move(submit));
    }

    /// DD13: returns the reason for ignoring the sample, if any.
    std::optional<IgnoreReason> ignoreReasonOf(const Submit& submit) const {
        if (submit.protocol != dds::kDdsProtocol) return IgnoreReason::OtherProtocol;
        if (submit.isTooLarge) return IgnoreReason::Malformed;
        const auto entry = clients_.find(submit.client);
        if (entry != clients_.end() && find(entry->second)->participant() != submit.participant)
            return IgnoreReason::OtherClient;
        // Samples of an ended session may still arrive.
        if (!opens(submit) && !knownParticipants_.contains(submit.participant))
            return IgnoreReason::NotGreeted;
        return std::nullopt;
    }

    /// DD3: returns the session of the sample's connection. Opens one if the sample opens a
    /// connection.
    std::shared_ptr<DdsSession> sessionOf(const Submit& submit) {
        if (const auto entry = clients_.find(submit.client); entry != clients_.end()) {
            const auto session = find(entry->second);
            if (session->connection() == submit.connection) return session;
            if (session->connection() > submit.connection) return nullptr;
            if (opens(submit)) session->cut();
        }
        return opens(submit) && !stopDeadline_ ? open(submit) : nullptr;
    }

    /// Remembers the participant. Drops those without a session if there are too many.
    void remember(const IgnoredSamples::Participant& participant) {
        if (knownParticipants_.size() >= 2 * options.maxSessions) {
            knownParticipants_.clear();
            for (const auto& [id, session] : sessions_)
                knownParticipants_.insert(session->participant());
        }
        knownParticipants_.insert(participant);
    }

    static bool opens(const Submit& submit) {
        return submit.answer && submit.segment.sequence == 0 && submit.ackReply == 0;
    }

    /// DD16: a session costs two writers of DDS, also when it ends at once.
    bool opensTooOften(const dds::ParticipantId& participant) {
        const TimePoint now = steady_clock::now();
        if (now >= openedSince_ + kOpenPause) {
            opened_.clear();
            openedSince_ = now;
        }
        return ++opened_[participant] > kMostOpened;
    }

    std::shared_ptr<DdsSession> open(const Submit& submit) {
        if (sessions_.size() >= options.maxSessions) {
            ++DdsHub::counters.turnedAway;
            return nullptr;
        }
        if (opensTooOften(submit.participant)) {
            ignored(IgnoreReason::TooMany, submit);
            return nullptr;
        }
        try {
            const auto session = createDdsSession(*this, lastSession_ + 1, submit);
            sessions_.emplace(++lastSession_, session);
            clients_[submit.client] = lastSession_;
            ++DdsHub::counters.accepted;
            remember(submit.participant);
            session->start();
            return session;
        } catch (const std::runtime_error& fault) {
            ++DdsHub::counters.turnedAway;
            log.write(LogLevel::Error, "session cannot be opened", {{"error", fault.what()}});
            return nullptr;
        }
    }

    // --- Sending

    void write(Revision revision, const Bytes& frame, const std::vector<SentCommits::Mark>& marks) {
        std::vector<usdlive_dds_Mark> list;
        for (const auto& [client, position] : marks) list.push_back({client, position});
        dds::CommitSample sample{};
        sample.server = server;
        sample.revision = revision;
        const auto size = std::uint32_t(list.size());
        sample.marks = {size, size, list.data(), false};
        sample.frame = dds::octets(frame);
        ++DdsHub::counters.messagesOut;
        ++DdsHub::counters.framesOut;
        DdsHub::counters.bytesOut += frame.size();
        // Clients request a lost commit again.
        static_cast<void>(commitWriter_.write(sample));
    }

    void flush() {
        // A flush can request another one, which then happens in the next turn.
        flushing_.swap(toFlush_);
        const TimePoint now = steady_clock::now();
        for (const auto& session : flushing_) {
            session->flush(now);
            wakeBy(std::max(session->deadline(), now + kLeastPause));
        }
        flushing_.clear();
    }

    void wakeBy(TimePoint time) {
        if (time >= timer_.expiry() && timerSet_) return;
        timerSet_ = true;
        timer_.expires_at(time);
        timer_.async_wait(whileAlive(life_, [this](boost::system::error_code error) {
            if (!error) onTimer();
        }));
    }

    void onTimer() {
        timerSet_ = false;
        const TimePoint now = steady_clock::now();
        TimePoint next = now + (stopDeadline_ ? kStoppingSweep : kSweep);
        for (const auto& session : all()) {
            session->sweep(now);
            if (now >= session->deadline()) session->flush(now);
            next = std::min(next, std::max(session->deadline(), now + kLeastPause));
        }
        statePublisher_.repeat(now);
        if (stopDeadline_ && now >= *stopDeadline_)
            for (const auto& session : all()) session->cut();
        const auto pause = revision_ != announced_ ? kAnnouncePause : kAnnounceAnyway;
        if (!stopDeadline_ && now >= announcedAt_ + pause) announce();
        wakeBy(next);
    }

    /// DD1: builds the announcement of the project. It owns no memory, so that it can be written or
    /// disposed.
    dds::ProjectSample projectSample() const {
        dds::ProjectSample sample{};
        sample.server = server;
        sample.name = const_cast<char*>(options.project.c_str());
        sample.url = const_cast<char*>(options.url.c_str());
        sample.protocol = dds::kDdsProtocol;
        sample.started = std::uint64_t(started_);
        sample.revision = revision_;
        sample.store = const_cast<char*>(options.store.value.c_str());
        return sample;
    }

    void announce() {
        announced_ = revision_;
        announcedAt_ = steady_clock::now();
        static_cast<void>(projectWriter_.write(projectSample()));
    }

    void notifyStopped() {
        if (stopped_ && sessions_.empty()) asio::post(io, std::exchange(stopped_, nullptr));
    }

    SessionId lastSession_;
    std::unordered_map<SessionId, std::shared_ptr<DdsSession>> sessions_;
    std::unordered_map<std::uint64_t, SessionId> clients_;
    std::vector<std::shared_ptr<DdsSession>> toFlush_, flushing_, closed_;
    std::set<IgnoredSamples::Participant>
        knownParticipants_;  // participants that have or had a session
    IgnoredSamples ignored_;
    mutable TransportCounters counters_;  // some are computed when they are requested

    Revision revision_, announced_ = 0;
    const std::int64_t started_;
    TimePoint announcedAt_;
    dds::Writer<dds::ProjectSample> projectWriter_;
    dds::Writer<dds::CommitSample> commitWriter_;
    DdsStatePublisher statePublisher_;

    asio::steady_timer timer_;
    bool timerSet_ = false;
    std::optional<TimePoint> stopDeadline_;
    std::function<void()> stopped_;
    std::map<dds::ParticipantId, std::uint64_t> opened_;  // sessions since openedSince_
    TimePoint openedSince_;
    WaitingSamples waiting_;
    SubmitThread submitThread_;  // the last member, because it posts to the others
};

}  // namespace

Result<std::unique_ptr<Transport>> createDdsServer(asio::io_context& io, DdsServerOptions options,
                                                   SessionHandler& handler, Background background,
                                                   Log& log) {
    auto domain = dds::createDomain(options.domain);
    if (!domain) return tl::unexpected(domain.error());
    try {
        return std::make_unique<DdsTransport>(io, std::move(options), handler,
                                              std::move(background), log, std::move(*domain));
    } catch (const std::runtime_error& fault) {
        return fail(ErrorCode::InvalidConfiguration, fault.what());
    }
}

}  // namespace usdlive::server
