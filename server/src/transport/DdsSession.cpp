#include "DdsSession.h"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <utility>

#include "ErrorFrame.h"
#include "FrameSources.h"
#include "QueueLimit.h"
#include "usdlive/common/dds/Topics.h"

namespace usdlive::server {

namespace {

namespace asio = boost::asio;
using dds::StreamMark;
using dds::TimePoint;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

// The other end takes a server for dead that says nothing.
constexpr milliseconds kKeepAlive{2'000};
// To send what is queued and to say goodbye.
constexpr milliseconds kCloseTime{5'000};
// What one request for missed commits brings at most.
constexpr std::size_t kResentBytes = 1024 * 1024;

std::uint8_t flagsOf(const dds::Segment& segment) {
    return std::uint8_t((segment.more ? dds::kMore : 0) | (segment.end ? dds::kEnd : 0) |
                        (segment.mark.hold ? dds::kHold : 0));
}

struct Writers {
    dds::Writer<dds::ReplySample> reply;
    dds::Writer<dds::BesideSample> beside;
};

class Session final : public DdsSession, public std::enable_shared_from_this<Session> {
public:
    Session(DdsHub& hub, SessionId id, const Submit& first)
        : hub_(hub),
          id_(id),
          client_(first.client),
          connection_(first.connection),
          participant_(first.participant),
          limit_(hub.options.slowReaderBytes),
          submits_(hub.options.maxMessageBytes),
          sources_(std::make_shared<FrameSources>(hub.io, hub.background, beside())) {
        const auto partition = dds::partitionOf(hub.server, client_);
        writers_ = std::make_shared<Writers>(
            Writers{dds::Writer<dds::ReplySample>(*hub.domain, partition),
                    dds::Writer<dds::BesideSample>(*hub.domain, partition)});
    }

    ~Session() override {
        // Cyclone may wait for a reader that hangs.
        if (writers_) hub_.background([writers = std::move(writers_)] {});
    }

    SessionId id() const override { return id_; }
    std::uint64_t client() const override { return client_; }
    std::uint64_t connection() const override { return connection_; }
    const OddSamples::Participant& participant() const override { return participant_; }

    void start() override {
        hub_.log.write(LogLevel::Info, "session opened", {{"session", id_}, {"from", "dds"}});
        guarded([this] { hub_.handler.opened(id_); });
    }

    void received(Submit submit) override {
        if (state_ == State::Closed) return;
        const TimePoint now = steady_clock::now();
        heard_ = now;
        answer_ = answer_ || submit.answer;
        hub_.counters.bytesIn += submit.segment.bytes.size();
        if (replies_.acknowledged(submit.ackReply, now)) onAcknowledged();
        if (beside_.acknowledged(submit.ackBeside, now)) sources_->produce();
        if (submit.segment.sequence != 0 && !submits_.received(submit.segment, now))
            hub_.ignored(Oddity::Malformed, submit);
        if (submit.resendFrom != 0) resend(submit.resendFrom, submit.resendTo);
        deliver();
        flushLater();
    }

    void send(SharedBytes frames) override {
        if (state_ != State::Open) return;
        if (!limit_.admit(replies_.queuedBytes(), frames->size()))
            return tooSlow("more is waiting to be read than a connection may have");
        push(std::move(frames), {lastCommit_});
    }

    std::optional<SentCommits::Mark> commitSent(Revision revision) override {
        if (state_ != State::Open) return std::nullopt;
        releaseCommits(revision);
        lastCommit_ = revision;
        if (std::exchange(marked_, streamEnd_) == streamEnd_) return std::nullopt;
        return SentCommits::Mark{client_, streamEnd_};
    }

    void sendCommit(SharedBytes frame, Revision revision) override {
        if (state_ != State::Open) return;
        if (!limit_.admit(replies_.queuedBytes(), frame->size()))
            return tooSlow("more is waiting to be read than a connection may have");
        push(std::move(frame), {lastCommit_, false, revision + 1});
        live_ = true;
        lastCommit_ = revision;
    }

    void holdCommits() override {
        if (state_ != State::Open) return;
        push(nullptr, {lastCommit_, true});
        live_ = false;
    }

    void releaseCommits(Revision next) override {
        if (state_ != State::Open || (live_ && lastCommit_ + 1 == next)) return;
        push(nullptr, {lastCommit_, false, next});
        live_ = true;
        lastCommit_ = next - 1;
    }

    void sendFirst(SharedBytes frame, std::uint64_t statesFrom,
                   std::uint64_t presencesFrom) override {
        if (state_ != State::Open) return;
        StreamMark mark{lastCommit_};
        mark.statesFrom = statesFrom;
        mark.presencesFrom = presencesFrom;
        push(std::move(frame), mark);
    }

    bool congested() override {
        if (state_ != State::Open || replies_.queuedBytes() <= Transport::kCongestedBytes)
            return false;
        tellDrained_ = true;
        return true;
    }

    void sendBeside(FrameSource source) override {
        if (state_ != State::Open) return;
        if (!sources_->add(std::move(source)))
            tooSlow("more was asked for at once than a connection may have");
    }

    void close(const std::optional<Error>& why) override {
        if (state_ != State::Open) return;
        state_ = State::Closing;
        closeDeadline_ = steady_clock::now() + kCloseTime;
        sources_->clear();
        if (why)
            hub_.log.write(
                LogLevel::Warning, "session refused",
                {{"session", id_}, {"code", errorName(why->code)}, {"reason", why->message}});
        else
            hub_.log.write(LogLevel::Info, "session closed", {{"session", id_}});
        hub_.tellClosed(id_);
        if (why) push(errorFrame(*why), {lastCommit_});
        replies_.pushEnd();
        flushLater();
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
        if (state_ == State::Closed) return;
        for (const dds::Segment& segment : replies_.take(now)) write(segment);
        for (const dds::Segment& segment : beside_.take(now)) writeBeside(segment);
        const auto ackDue = submits_.ackDue();
        if (answer_ || (ackDue && now >= *ackDue) || now >= spoke_ + kKeepAlive) write({});
        if (state_ == State::Closing && replies_.isEmpty()) end("closed", LogLevel::Debug);
    }

    void sweep(TimePoint now) override {
        const auto stalled = [&](const dds::SegmentSender& stream) {
            const auto since = stream.stalledSince();
            return since && now - *since >= hub_.options.slowReaderTime;
        };
        if (state_ == State::Closing && now >= closeDeadline_)
            end("it did not close in time", LogLevel::Debug);
        else if (state_ == State::Open && now - heard_ >= hub_.options.peerTime)
            end("nothing was heard of it", LogLevel::Info);
        else if (state_ == State::Open && (stalled(replies_) || stalled(beside_))) {
            ++hub_.counters.slowReaders;
            end("it did not read for too long", LogLevel::Warning);
        }
    }

    TimePoint deadline() const override {
        TimePoint earliest = spoke_ + kKeepAlive;
        for (const auto& due : {replies_.deadline(), beside_.deadline(), submits_.ackDue()})
            if (due) earliest = std::min(earliest, *due);
        return earliest;
    }

    std::size_t queuedBytes() const override {
        return replies_.queuedBytes() + beside_.queuedBytes();
    }

    void cut() override { end("cut", LogLevel::Debug); }

private:
    enum class State {
        Open,
        Closing,  // the handler has been told; the queue and the goodbye leave
        Closed
    };

    // What the handler throws is a bug that concerns this session only, as far as one knows.
    template <class Function>
    void guarded(Function&& function) {
        try {
            function();
        } catch (const std::exception& fault) {
            hub_.log.write(LogLevel::Error, "session met a fault",
                           {{"session", id_}, {"error", fault.what()}});
            close(internal());
        }
    }

    void flushLater() {
        if (!std::exchange(flushing_, true)) hub_.flushLater(shared_from_this());
    }

    void push(SharedBytes frames, StreamMark mark) {
        if (frames) {
            streamEnd_ += frames->size();
            ++hub_.counters.framesOut;
        }
        replies_.push(std::move(frames), mark);
        flushLater();
    }

    // --- Samples

    /// Without a number it only acknowledges, and says that the server lives.
    void write(const dds::Segment& segment) {
        dds::ReplySample sample{};
        sample.number = segment.sequence;
        sample.afterCommit = segment.sequence != 0 ? segment.mark.afterCommit : lastCommit_;
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
        spoke_ = steady_clock::now();
        count(sample.frames._length);
        // What is not taken is sent again with what is not acknowledged.
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

    /// DD7. What is too old is had by resuming.
    void resend(Revision from, Revision to) {
        if (from > hub_.commits.newest()) return;
        if (!hub_.commits.find(from)) {
            ++hub_.counters.slowReaders;
            return end("it has missed more commits than are kept", LogLevel::Warning);
        }
        std::size_t bytes = 0;
        for (Revision revision = from; revision <= to && bytes < kResentBytes; ++revision) {
            const SentCommits::Sent* sent = hub_.commits.find(revision);
            if (!sent) return;
            if (!sent->frame) continue;
            dds::ReplySample sample{};
            sample.afterCommit = lastCommit_;
            sample.resent = revision;
            sample.mark = sent->positionOf(client_);
            sample.frames = dds::octets(*sent->frame);
            bytes += sent->frame->size();
            write(sample);
        }
    }

    // --- What comes

    void deliver() {
        while (state_ == State::Open && reading_) {
            const auto message = submits_.take(steady_clock::now());
            if (!message) break;
            ++hub_.counters.messagesIn;
            if (message->bytes && !message->bytes->empty())
                guarded([&] { hub_.handler.received(id_, *message->bytes); });
            if (message->end) return end("it left", LogLevel::Info);
        }
        if (submits_.isTooLarge())
            close(Error{
                ErrorCode::FrameTooLarge,
                "a message may have " + std::to_string(hub_.options.maxMessageBytes) + " bytes"});
    }

    void onAcknowledged() {
        if (!tellDrained_ || replies_.queuedBytes() > Transport::kCongestedBytes) return;
        tellDrained_ = false;
        guarded([this] { hub_.handler.drained(id_); });
    }

    FrameSources::Session beside() {
        return {[this] { return beside_.waitingBytes() <= Transport::kBesideBytes; },
                [this](SharedBytes frame) {
                    ++hub_.counters.framesOut;
                    beside_.push(std::move(frame));
                    flushLater();
                },
                [this] { close(internal()); }};
    }

    // --- The end

    void tooSlow(std::string message) {
        ++hub_.counters.slowReaders;
        replies_.dropWaiting();
        close(Error{ErrorCode::SlowReader, std::move(message)});
    }

    void end(std::string_view reason, LogLevel level) {
        if (state_ == State::Closed) return;
        const State before = std::exchange(state_, State::Closed);
        if (before == State::Open) hub_.tellClosed(id_);
        if (before != State::Closing)
            hub_.log.write(level, "session ended", {{"session", id_}, {"reason", reason}});
        sources_->clear();
        // Should it still be there, it comes again at once.
        dds::ReplySample reset{};
        reset.flags = dds::kEnd;
        write(reset);
        hub_.finished(*this);
    }

    DdsHub& hub_;
    const SessionId id_;
    const std::uint64_t client_, connection_;
    const OddSamples::Participant participant_;
    State state_ = State::Open;
    std::shared_ptr<Writers> writers_;

    QueueLimit limit_;
    dds::SegmentReceiver submits_;
    bool reading_ = true;
    bool answer_ = false;  // it waits for a sign of life
    TimePoint heard_ = steady_clock::now();

    dds::SegmentSender replies_, beside_;
    std::uint64_t streamEnd_ = 0;  // bytes of all that was pushed
    std::uint64_t marked_ = 0;     // as the latest commits say
    Revision lastCommit_ = 0;      // that it was sent, or was sent with the others
    bool live_ = false;
    bool flushing_ = false;  // flush() was asked for and has not come yet
    bool tellDrained_ = false;
    TimePoint spoke_, closeDeadline_;

    const std::shared_ptr<FrameSources> sources_;
};

}  // namespace

std::shared_ptr<DdsSession> createDdsSession(DdsHub& hub, SessionId id, const Submit& first) {
    return std::make_shared<Session>(hub, id, first);
}

}  // namespace usdlive::server
