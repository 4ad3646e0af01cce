#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "FrameSources.h"
#include "QueueLimit.h"
#include "usdlive/server/transport/Log.h"
#include "usdlive/server/transport/Transport.h"

namespace usdlive::server {

/// What the sessions of a transport share. It belongs to the thread that runs `io`.
class SessionHub {
public:
    boost::asio::io_context& io;
    SessionHandler& handler;
    const Background background;
    Log& log;
    TransportCounters counters;

    /// Tells the handler that the session is closed, later in this turn of the event loop.
    void tellClosed(SessionId session);

protected:
    SessionHub(boost::asio::io_context& io, SessionHandler& handler, Background background,
               Log& log)
        : io(io), handler(handler), background(std::move(background)), log(log) {}
    ~SessionHub() = default;

    /// Ends with the hub: whileAlive() of it.
    const std::shared_ptr<int> life_ = std::make_shared<int>();
};

/// A session on any transport: its state, its end, how much may wait for its reader, and the calls
/// of the handler. What the bytes travel in is up to the class that derives from it.
class SessionCore {
public:
    virtual ~SessionCore() = default;
    [[nodiscard]] SessionId id() const { return id_; }

    void send(SharedBytes frames);
    /// See Transport::congested().
    [[nodiscard]] bool congested();
    void sendBeside(FrameSource source);
    /// Sends what is queued and the error, then says goodbye. The handler is told at once.
    void close(const std::optional<Error>& why);
    /// Ends the session without a goodbye.
    void cut() { end("cut", LogLevel::Debug); }

protected:
    enum class State {
        Opening,  ///< not yet known to the handler
        Open,
        Closing,  ///< the handler has been told; the queue and the goodbye leave
        Closed
    };
    SessionCore(SessionHub& hub, SessionId id, std::size_t slowReaderBytes, State state);

    // Of the line.
    /// Bytes of the stream that wait or are on their way; what is sent beside it does not count.
    [[nodiscard]] virtual std::size_t waitingBytes() const = 0;
    virtual void queue(SharedBytes frames) = 0;
    /// Queues a frame of a source, which takes turns with the stream.
    virtual void queueBeside(SharedBytes frame) = 0;
    [[nodiscard]] virtual bool hasRoomBeside() const = 0;
    /// Drops what is queued and not on its way.
    virtual void dropQueue() = 0;
    /// Begins to say goodbye, after what is queued.
    virtual void beginGoodbye(const std::optional<Error>& why) = 0;
    /// The session is over: closes the line, and has the hub forget it.
    virtual void finish() = 0;

    [[nodiscard]] State state() const { return state_; }
    [[nodiscard]] bool isOpen() const { return state_ == State::Open; }
    /// Tells the handler of the session.
    void open();
    /// Returns whether more may wait for the reader. If not, the session is closed with slowReader.
    [[nodiscard]] bool admit(std::size_t bytes);
    /// Call it when something has left: tells the handler and asks sources for more.
    void left();
    /// Closes a session that has not finished its goodbye in time; true if it has.
    bool sweepGoodbye(std::chrono::steady_clock::time_point now);
    void endSlowReader(std::string_view reason);
    void end(std::string_view reason, LogLevel level);
    /// Ends it without telling anybody: the hub goes.
    void endSilently();
    /// Calls the handler. What it throws is a bug that concerns this session only, as far as one
    /// knows.
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
    bool tellDrained_ = false;
    std::chrono::steady_clock::time_point closeDeadline_;
    const std::shared_ptr<FrameSources> sources_;
};

}  // namespace usdlive::server
