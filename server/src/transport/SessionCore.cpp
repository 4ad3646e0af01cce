// The common part of sessions on all transports.
#include "transport/SessionCore.h"

#include <boost/asio/post.hpp>
#include <utility>

#include "transport/ErrorFrame.h"
#include "transport/WhileAlive.h"

namespace usdlive::server {

namespace {

using std::chrono::steady_clock;

// The time limit for sending the queue and the goodbye.
constexpr std::chrono::milliseconds kCloseTime{5'000};

}  // namespace

void SessionHub::notifyClosed(SessionId session) {
    boost::asio::post(io, whileAlive(life_, [this, session] { handler.closed(session); }));
}

SessionCore::SessionCore(SessionHub& hub, SessionId id, std::size_t slowReaderBytes, State state)
    : core_(hub),
      id_(id),
      state_(state),
      limit_(slowReaderBytes),
      sources_(std::make_shared<FrameSources>(
          hub.io, hub.background,
          FrameSources::Session{[this] { return besideBytes(); },
                                [this](SharedBytes frame) { queueBeside(std::move(frame)); },
                                [this] { close(internal()); }})) {}

void SessionCore::open(const std::optional<SignedIn>& user) {
    openUnproved();
    isReported_ = true;
    guarded([&] { core_.handler.opened(id_, user); });
}

void SessionCore::openUnproved() {
    state_ = State::Open;
    greetDeadline_ = steady_clock::now() + core_.greetTime;
}

void SessionCore::proved(const SignedIn& user) {
    isReported_ = true;
    guarded([&] { core_.handler.opened(id_, user); });
}

void SessionCore::deliver(ByteView message) {
    ++core_.counters.messagesIn;
    if (!isReported_) return prove(message);
    guarded([&] { core_.handler.received(id_, message); });
    if (!isOpen() || std::exchange(hasSpoken_, true)) return;
    if (const auto seated = spoke(); !seated) close(seated.error());
}

bool SessionCore::sweepGreeting(steady_clock::time_point now) {
    if (!isOpen() || hasSpoken_ || now < greetDeadline_) return false;
    close(Error{ErrorCode::NotGreeted,
                "no hello arrived within " + std::to_string(core_.greetTime.count()) + " ms"});
    return true;
}

void SessionCore::send(SharedBytes frames) {
    if (isOpen() && admit(frames->size())) queue(std::move(frames));
}

bool SessionCore::admit(std::size_t bytes) {
    if (limit_.admit(waitingBytes(), bytes)) return true;
    tooSlow("the client reads too slowly: too much data waits for it");
    return false;
}

bool SessionCore::congested() {
    if (!isOpen() || waitingBytes() <= Transport::kCongestedBytes) return false;
    notifyDrained_ = true;
    return true;
}

void SessionCore::sendBeside(FrameSource source) {
    if (isOpen() && !sources_->add(std::move(source)))
        tooSlow("the client requested too many things at once");
}

void SessionCore::left() {
    if (notifyDrained_ && waitingBytes() <= Transport::kCongestedBytes) {
        notifyDrained_ = false;
        guarded([this] { core_.handler.drained(id_); });
    }
    sources_->produce();
}

void SessionCore::close(const std::optional<Error>& why) {
    if (state_ == State::Opening) return end("closed before it was open", LogLevel::Debug);
    if (!isOpen()) return;
    state_ = State::Closing;
    closeDeadline_ = steady_clock::now() + kCloseTime;
    sources_->clear();
    if (why)
        core_.log.write(
            LogLevel::Warning, "session refused",
            {{"session", id_}, {"code", errorName(why->code)}, {"reason", why->message}});
    else
        core_.log.write(LogLevel::Info, "session closed", {{"session", id_}});
    if (isReported_) core_.notifyClosed(id_);
    if (why) queue(errorFrame(*why));
    beginGoodbye(why);
}

void SessionCore::tooSlow(std::string message) {
    ++core_.counters.slowReaders;
    dropQueue();  // the error follows the message that is being sent
    close(Error{ErrorCode::SlowReader, std::move(message)});
}

bool SessionCore::sweepGoodbye(steady_clock::time_point now) {
    if (state_ != State::Closing || now < closeDeadline_) return false;
    end("the client did not close in time", LogLevel::Debug);
    return true;
}

void SessionCore::endSlowReader(std::string_view reason) {
    ++core_.counters.slowReaders;
    end(reason, LogLevel::Warning);
}

void SessionCore::end(std::string_view reason, LogLevel level) {
    if (state_ == State::Closed) return;
    const State before = std::exchange(state_, State::Closed);
    if (before == State::Open && isReported_) core_.notifyClosed(id_);
    if (before != State::Closing)
        core_.log.write(level, "session ended", {{"session", id_}, {"reason", reason}});
    sources_->clear();
    finish();
}

void SessionCore::endSilently() {
    state_ = State::Closed;
    sources_->clear();
}

void SessionCore::failed(const std::exception& fault) {
    core_.log.write(LogLevel::Error, "session met a fault",
                    {{"session", id_}, {"error", fault.what()}});
    close(internal());
}

}  // namespace usdlive::server
