// A session: the state of one connection that all parts share.
#pragma once

#include <set>
#include <string>
#include <variant>
#include <vector>

#include "project/Subject.h"
#include "project/ports/Outbox.h"  // SessionId
#include "usdlive/common/protocol/CompactFrame.h"
#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// The session has sent no hello yet.
struct AwaitingHello {};
/// The session resumes at a revision. The client's transactions, or the hash of the revision, are
/// being read from the store. Frames that arrive meanwhile wait.
struct CheckingResume {
    Hello hello;
    std::vector<Bytes> waiting;  ///< received frames
    std::size_t waitingBytes = 0;
};
/// The session was sent its welcome.
struct Greeted {};
/// Queued messages are still sent. Received messages are ignored.
struct Closing {};
using SessionPhase = std::variant<AwaitingHello, CheckingResume, Greeted, Closing>;

struct Session {
    SessionId id = 0;
    SessionPhase phase;
    ClientId client;
    Subject subject;
    /// shareOf(); empty if nobody knows whose it is, as over DDS without DDS Security.
    std::string share;
    std::string application;
    std::set<std::string> features;  ///< features that both ends support
    std::set<LayerId> open;
    CompactReader compact;    ///< reads the session's compact frames (FR9)
    bool wasGreeted = false;  ///< true after the welcome, also while it is closing

    [[nodiscard]] bool isGreeted() const { return std::holds_alternative<Greeted>(phase); }
    [[nodiscard]] bool isClosing() const { return std::holds_alternative<Closing>(phase); }
};

/// A part that keeps data for each session.
class SessionListener {
public:
    virtual ~SessionListener() = default;

    /// Called when the session begins to close: no more messages are received from it, and no more
    /// work is started for it.
    virtual void closing(SessionId /*session*/) {}
    /// Called when the connection has ended and the session was removed from the table.
    virtual void left(const Session& /*session*/) {}
    /// Called when a session has opened or closed the layer.
    virtual void openChanged(const LayerId& /*layer*/) {}
};

}  // namespace usdlive::server
