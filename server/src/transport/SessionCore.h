// The part of a session that all transports share.
#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "transport/FrameSources.h"
#include "transport/Log.h"
#include "transport/QueueLimit.h"
#include "transport/Transport.h"

namespace usdlive::server {

/// The part of a transport that its sessions share. Belongs to the thread that runs `io`.
class SessionHub {
public:
    boost::asio::io_context& io;
    SessionHandler& handler;
    const Background background;
    Log& log;
    /// The time limit for the first message of a session, its hello.
    const std::chrono::milliseconds greetTime;
    TransportCounters counters;

    /// Notifies the handler of the closed session, later in this turn of the event loop.
    void notifyClosed(SessionId session);

protected:
    SessionHub(boost::asio::io_context& io, SessionHandler& handler, Background background,
               Log& log, std::chrono::milliseconds greetTime)
        : io(io),
          handler(handler),
          background(std::move(background)),
          log(log),
          greetTime(greetTime) {}
    ~SessionHub() = default;

    /// The life of the hub for whileAlive().
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

/// A session on any transport: its state, its end, the limit for its reader, and the calls to the
/// handler. Derived classes send the bytes.
class SessionCore {
public:
    virtual ~SessionCore() = default;
    [[nodiscard]] SessionId id() const { return id_; }

    void send(SharedBytes frames);
    /// See Transport::congested().
    [[nodiscard]] bool congested();
    void sendBeside(FrameSource source);
    /// Sends the queued frames and the error, then a goodbye. The handler is notified at once.
    void close(const std::optional<Error>& why);
    /// Ends the session without a goodbye.
    void cut() { end("cut", LogLevel::Debug); }

protected:
    enum class State {
        Opening,  ///< the handler does not know it yet
        Open,
        Closing,  ///< the handler was notified; the queue and the goodbye are being sent
        Closed
    };
    SessionCore(SessionHub& hub, SessionId id, std::size_t slowReaderBytes, State state);

    // Implemented by the derived class.
    /// Returns the bytes of the stream that wait or are being sent, without those beside the
    /// stream.
    [[nodiscard]] virtual std::size_t waitingBytes() const = 0;
    virtual void queue(SharedBytes frames) = 0;
    /// Queues a frame of a source. It takes turns with the stream.
    virtual void queueBeside(SharedBytes frame) = 0;
    /// Returns the size of the next frame of a source; 0: there is no room for one.
    [[nodiscard]] virtual std::size_t besideBytes() const = 0;
    /// Drops the queued frames that are not being sent.
    virtual void dropQueue() = 0;
    /// Starts the goodbye after the queued frames.
    virtual void beginGoodbye(const std::optional<Error>& why) = 0;
    /// Closes the connection and makes the hub forget the session.
    virtual void finish() = 0;

    [[nodiscard]] State state() const { return state_; }
    [[nodiscard]] bool isOpen() const { return state_ == State::Open; }
    /// Reports the new session to the handler.
    void open(const std::optional<SignedIn>& user);
    /// Opens a session that the handler does not know yet: its first message is passed to prove().
    void openUnproved();
    /// Reports a session of openUnproved() to the handler.
    void proved(const SignedIn& user);
    /// Passes a message to the handler.
    void deliver(ByteView message);
    virtual void prove(ByteView /*message*/) {}
    /// Returns whether the session has sent a message that the handler accepted: its hello.
    [[nodiscard]] bool hasSpoken() const { return hasSpoken_; }
    /// Called after the first message. Error: the session is closed with it.
    virtual Result<void> spoke() { return {}; }
    /// Closes a session that has sent no message in time. Returns true if it did.
    bool sweepGreeting(std::chrono::steady_clock::time_point now);
    /// Returns true if more may wait for the reader. Otherwise closes the session with SlowReader.
    [[nodiscard]] bool admit(std::size_t bytes);
    /// Call it after data was sent: notifies the handler and asks the sources for more.
    void left();
    /// Closes a session that has not finished its goodbye in time. Returns true if it is closing.
    bool sweepGoodbye(std::chrono::steady_clock::time_point now);
    void endSlowReader(std::string_view reason);
    void end(std::string_view reason, LogLevel level);
    /// Ends the session without notifying the handler, because the hub is being destroyed.
    void endSilently();
    /// Calls the handler. An exception is a bug that probably concerns this session only.
    template <class Function>
    void guarded(Function&& function) try {
        function();
    } catch (const std::exception& fault) {
        failed(fault);
    }
    [[nodiscard]] FrameSources& sources() { return *sources_; }

private:
    void failed(const std::exception& fault);
    void tooSlow(std::string message);

    SessionHub& core_;
    const SessionId id_;
    State state_;
    QueueLimit limit_;
    bool notifyDrained_ = false;
    bool hasSpoken_ = false;
    bool isReported_ = false;  // the handler knows it
    std::chrono::steady_clock::time_point greetDeadline_;
    std::chrono::steady_clock::time_point closeDeadline_;
    const std::shared_ptr<FrameSources> sources_;
};

}  // namespace usdlive::server
