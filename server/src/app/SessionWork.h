// Handles the messages of sessions in fair turns.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <functional>
#include <map>
#include <optional>

#include "app/FairTurns.h"
#include "usdlive/common/core/Bytes.h"

namespace usdlive::server {

/// Passes the messages of sessions to the project, in an order and in pieces by which nobody delays
/// the others (SE23). A message that has to wait, or what is left of it when its turn ends, is kept
/// here, and nothing more is read from its session until it was handled: the flow control of the
/// connection then slows the client down. So at most one message of each session waits. The frames
/// of a session keep their order.
///
/// Belongs to the network thread, which runs `io`; the calls are made there.
class SessionWork {
public:
    struct Calls {
        /// Handles whole frames of the session. An exception drops the rest of the message.
        std::function<void(SessionId, ByteView frames)> handle;
        std::function<void(SessionId, bool reading)> setReading;
        /// An empty group: the session has not said hello, or has ended. Its work is not counted.
        std::function<Party(SessionId)> partyOf;
        /// The commits that wait for the store.
        std::function<FairTurns::Store()> store;
        /// Called with an exception of `handle` in a later turn than the session's own call.
        std::function<void(SessionId, const std::exception&)> failed;
    };

    SessionWork(boost::asio::io_context& io, Calls calls);

    /// Handles the message now, or as much of it as a turn allows, or keeps it. An exception of
    /// Calls::handle passes through.
    void received(SessionId session, ByteView message);
    /// Drops what waits of the session.
    void closed(SessionId session);
    /// A session whose jobs take too much is not read, and what waits of it is not handled.
    void setHeld(SessionId session, bool held);
    /// Call it when Calls::store may return something else.
    void storeChanged() { runSoon(); }
    /// Work for the session was done elsewhere, such as on a worker. It counts as its party's.
    void spent(SessionId session, FairTurns::Duration time);

private:
    struct Entry {
        Bytes message;  ///< the frames that wait, from `at` on
        std::size_t at = 0;
        bool isHeld = false;
        bool isReading = true;
    };

    std::size_t work(SessionId session, ByteView frames);
    void spent(const Party& party, FairTurns::Duration time, FairTurns::Time now);
    void keep(SessionId session, ByteView frames);
    void waitForTurn(SessionId session);
    void turnOf(SessionId session);
    void setReading(SessionId session);
    void runSoon();
    void run();
    void measure(FairTurns::Duration handled, FairTurns::Time now);

    boost::asio::io_context& io_;
    const Calls calls_;
    FairTurns turns_;
    std::map<SessionId, Entry> entries_;
    std::optional<SessionId> working_;  // its frames are handled now; nothing: it was closed then
    boost::asio::steady_timer timer_;
    bool isRunning_ = false;  // run() is posted

    // Handling an edit also causes work that follows later, such as sending its commit to
    // everybody.
    double factor_ = 1;  // the thread's time for a moment of handling, including what follows
    FairTurns::Duration handled_{};     // since measuredAt_
    FairTurns::Duration threadTime_{};  // at measuredAt_
    FairTurns::Time measuredAt_{};
};

}  // namespace usdlive::server
