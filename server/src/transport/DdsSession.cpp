// One client's session over DDS.
#include "transport/DdsSession.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <utility>

#include "transport/ReplyMarks.h"
#include "usdlive/common/dds/Topics.h"
#include "usdlive/common/transport/BulkWindow.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
using dds::StreamMark;
using dds::TimePoint;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// The client treats a silent server as lost, so a sign of life is sent this often.
constexpr milliseconds kKeepAlive{2'000};
// The limit for one answer to a request for missed commits.
constexpr std::size_t kResentBytes = 1024 * 1024;

std::uint8_t flagsOf(const dds::Segment& segment) {
    return std::uint8_t((segment.more ? dds::kMore : 0) | (segment.end ? dds::kEnd : 0) |
                        (segment.mark.hold ? dds::kHold : 0));
}

struct Writers {
    dds::Writer<dds::ReplySample> reply;
    dds::Writer<dds::BesideSample> beside;
};

class PeerSession final : public DdsSession, public std::enable_shared_from_this<PeerSession> {
public:
    PeerSession(DdsHub& hub, SessionId id, const Submit& first)
        : DdsSession(hub, id, hub.options.slowReaderBytes, State::Open),
          hub_(hub),
          client_(first.client),
          connection_(first.connection),
          participant_(first.participant),
          user_(first.user),
          submits_(hub.options.maxMessageBytes) {
        const auto partition = dds::partitionOf(hub.server, client_);
        writers_ = std::make_shared<Writers>(
            Writers{dds::Writer<dds::ReplySample>(*hub.domain, partition),
                    dds::Writer<dds::BesideSample>(*hub.domain, partition)});
    }

    ~PeerSession() override {
        // Destroyed in the background, because Cyclone DDS may wait for a reader that does not
        // respond.
        if (writers_) hub_.background([writers = std::move(writers_)] {});
    }

    std::uint64_t client() const override { return client_; }
    std::uint64_t connection() const override { return connection_; }
    const IgnoredSamples::Participant& participant() const override { return participant_; }

    void start() override {
        hub_.log.write(LogLevel::Info, "session opened", {{"session", id()}, {"from", "dds"}});
        if (hub_.options.domain.securityFolder.empty()) return open(std::nullopt);
        open(SignedIn{UserName{user_}, Role::Editor, kByCertificate});
    }

    void received(Submit submit) override {
        if (state() == State::Closed) return;
        const TimePoint now = steady_clock::now();
        lastReceived_ = now;
        answer_ = answer_ || submit.answer;
        hub_.counters.bytesIn += submit.segment.bytes.size();
        const bool reply = replies_.acknowledged(submit.ackReply, now);
        const bool beside = beside_.acknowledged(submit.ackBeside, now);
        if (beside) besideWindow_.acknowledged(besidePushed_ - beside_.queuedBytes(), now);
        if (reply || beside) left();
        if (submit.segment.sequence != 0 && !submits_.received(submit.segment, now))
            hub_.ignored(IgnoreReason::Malformed, submit);
        if (submit.resendFrom != 0) resend(submit.resendFrom, submit.resendTo);
        deliver();
        flushLater();
    }

    void commitSent(Revision revision) override {
        if (!isOpen()) return;
        if (const auto mark = marks_.commitSent(revision)) push(nullptr, *mark);
    }

    std::optional<SentCommits::Mark> mark() override {
        const auto position = isOpen() ? marks_.unmarked() : std::nullopt;
        if (!position) return std::nullopt;
        return SentCommits::Mark{client_, *position};
    }

    void sendCommit(SharedBytes frame, Revision revision) override {
        if (!isOpen() || !admit(frame->size())) return;
        const StreamMark mark = marks_.commit(frame->size(), revision);
        push(std::move(frame), mark);
    }

    void holdCommits() override {
        if (isOpen()) push(nullptr, marks_.hold());
    }

    void releaseCommits(Revision next) override {
        if (!isOpen()) return;
        if (const auto mark = marks_.release(next)) push(nullptr, *mark);
    }

    void sendFirst(SharedBytes frame, std::uint64_t statesFrom,
                   std::uint64_t presencesFrom) override {
        if (!isOpen()) return;
        StreamMark mark = marks_.frames(frame ? frame->size() : 0);
        mark.statesFrom = statesFrom;
        mark.presencesFrom = presencesFrom;
        push(std::move(frame), mark);
    }

    void setReading(bool reading) override {
        if (!std::exchange(reading_, reading) && reading)
            asio::post(hub_.io, [weak = weak_from_this()] {
                if (const auto self = weak.lock()) {
                    self->deliver();
                    self->flushLater();
                }
            });
    }

    void flush(TimePoint now) override {
        flushing_ = false;
        if (state() == State::Closed) return;
        for (const dds::Segment& segment : replies_.take(now)) write(segment);
        for (const dds::Segment& segment : beside_.take(now)) writeBeside(segment);
        const auto ackDue = submits_.ackDue();
        if (answer_ || (ackDue && now >= *ackDue) || now >= lastSent_ + kKeepAlive) write({});
        if (state() == State::Closing && replies_.isEmpty()) end("closed", LogLevel::Debug);
    }

    void sweep(TimePoint now) override {
        const auto stalled = [&](const dds::SegmentSender& stream) {
            const auto since = stream.stalledSince();
            return since && now - *since >= hub_.options.slowReaderTime;
        };
        if (sweepGoodbye(now) || !isOpen() || sweepGreeting(now)) return;
        if (now - lastReceived_ >= hub_.options.peerTime)
            end("the client sent nothing for too long", LogLevel::Info);
        else if (stalled(replies_) || stalled(beside_))
            endSlowReader("it did not read for too long");
    }

    TimePoint deadline() const override {
        TimePoint earliest = lastSent_ + kKeepAlive;
        for (const auto& due : {replies_.deadline(), beside_.deadline(), submits_.ackDue()})
            if (due) earliest = std::min(earliest, *due);
        return earliest;
    }

    std::size_t queuedBytes() const override {
        return replies_.queuedBytes() + beside_.queuedBytes();
    }

private:
    // Implements SessionCore.
    std::size_t waitingBytes() const override { return replies_.queuedBytes(); }
    std::size_t besideBytes() const override { return besideWindow_.partBytes(); }
    void queue(SharedBytes frames) override {
        const StreamMark mark = marks_.frames(frames->size());
        push(std::move(frames), mark);
    }
    void queueBeside(SharedBytes frame) override {
        ++hub_.counters.framesOut;
        besidePushed_ += frame->size();
        besideWindow_.queued(frame->size());
        besideWindow_.sent(frame->size());
        besideWindow_.mark(steady_clock::now());
        beside_.push(std::move(frame));
        flushLater();
    }
    void dropQueue() override { replies_.dropWaiting(); }
    void beginGoodbye(const std::optional<Error>&) override {
        replies_.pushEnd();
        flushLater();
    }
    void finish() override {
        // If the client is still there, it connects again at once.
        dds::ReplySample reset{};
        reset.flags = dds::kEnd;
        write(reset);
        hub_.finished(*this);
    }

    void flushLater() {
        if (!std::exchange(flushing_, true)) hub_.flushLater(shared_from_this());
    }

    void push(SharedBytes frames, StreamMark mark) {
        if (frames) ++hub_.counters.framesOut;
        replies_.push(std::move(frames), mark);
        flushLater();
    }

    // --- Samples

    /// A segment without a number only acknowledges and is a sign of life.
    void write(const dds::Segment& segment) {
        dds::ReplySample sample{};
        sample.number = segment.sequence;
        sample.afterCommit = segment.sequence != 0 ? segment.mark.afterCommit : marks_.lastCommit();
        sample.liveFrom = segment.mark.liveFrom;
        sample.statesFrom = segment.mark.statesFrom;
        sample.presencesFrom = segment.mark.presencesFrom;
        sample.flags = flagsOf(segment);
        sample.frames = dds::octets(segment.bytes);
        write(sample);
    }

    void write(dds::ReplySample& sample) {
        sample.client = client_;
        sample.connection = connection_;
        sample.ackSubmit = submits_.taken();
        submits_.ackSent();
        answer_ = false;
        lastSent_ = steady_clock::now();
        count(sample.frames._length);
        // A sample that DDS does not accept is sent again like an unacknowledged one.
        static_cast<void>(writers_->reply.write(sample));
    }

    void writeBeside(const dds::Segment& segment) {
        dds::BesideSample sample{};
        sample.client = client_;
        sample.connection = connection_;
        sample.number = segment.sequence;
        sample.flags = flagsOf(segment);
        sample.frames = dds::octets(segment.bytes);
        count(sample.frames._length);
        static_cast<void>(writers_->beside.write(sample));
    }

    void count(std::size_t bytes) {
        ++hub_.counters.messagesOut;
        hub_.counters.bytesOut += bytes;
    }

    /// DD7: sends missed commits again. Older ones require the client to resume.
    void resend(Revision from, Revision to) {
        if (from > hub_.commits.newest()) return;
        if (!hub_.commits.find(from)) {
            return endSlowReader("the client has missed more commits than are kept");
        }
        std::size_t bytes = 0;
        for (Revision revision = from; revision <= to && bytes < kResentBytes; ++revision) {
            const SentCommits::Sent* sent = hub_.commits.find(revision);
            if (!sent) return;
            if (!sent->frame) continue;
            dds::ReplySample sample{};
            sample.afterCommit = marks_.lastCommit();
            sample.resent = revision;
            sample.mark = sent->positionOf(client_);
            sample.frames = dds::octets(*sent->frame);
            bytes += sent->frame->size();
            write(sample);
        }
    }

    // --- Receiving

    void deliver() {
        while (isOpen() && reading_) {
            const auto message = submits_.take(steady_clock::now());
            if (!message) break;
            if (message->bytes && !message->bytes->empty()) SessionCore::deliver(*message->bytes);
            if (message->end) return end("it left", LogLevel::Info);
        }
        if (submits_.isTooLarge())
            close(Error{ErrorCode::FrameTooLarge, "a message may have at most " +
                                                      std::to_string(hub_.options.maxMessageBytes) +
                                                      " bytes"});
    }

    DdsHub& hub_;
    const std::uint64_t client_, connection_;
    const IgnoredSamples::Participant participant_;
    const std::string user_;
    std::shared_ptr<Writers> writers_;

    dds::SegmentReceiver submits_;
    bool reading_ = true;
    bool answer_ = false;  // the client waits for a sign of life
    TimePoint lastReceived_ = steady_clock::now();

    dds::SegmentSender replies_, beside_;
    BulkWindow besideWindow_;
    std::uint64_t besidePushed_ = 0;  // bytes
    ReplyMarks marks_;
    bool flushing_ = false;  // flush() is requested and has not run yet
    TimePoint lastSent_;
};

}  // namespace

std::shared_ptr<DdsSession> createDdsSession(DdsHub& hub, SessionId id, const Submit& first) {
    return std::make_shared<PeerSession>(hub, id, first);
}

}  // namespace usdlive::server
