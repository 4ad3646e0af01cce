// One connection, as the whole project knows it.
#pragma once

#include <set>
#include <string>
#include <variant>
#include <vector>

#include "usdlive/common/protocol/Control.h"
#include "usdlive/server/project/ports/Outbox.h"  // SessionId

namespace usdlive::server {

/// An authenticated user. The name is the one in hello; there is no authentication yet.
struct Subject {
    UserName user;
    bool isAdministrator = false;
};

/// Has sent no hello yet.
struct AwaitingHello {};
/// Wants to resume at a revision. What the client has committed, or the revision's hash, is being
/// read from the store. Frames that arrive meanwhile wait.
struct CheckingResume {
    Hello hello;
    std::vector<Bytes> waiting;  ///< frames
    std::size_t waitingBytes = 0;
};
/// Has got its welcome.
struct Greeted {};
/// Queued messages are still sent to it; nothing is received from it any more.
struct Closing {};
using SessionPhase = std::variant<AwaitingHello, CheckingResume, Greeted, Closing>;

struct Session {
    SessionId id = 0;
    SessionPhase phase;
    ClientId client;
    Subject subject;
    std::string application;
    std::set<std::string> features;  ///< that both ends have
    std::set<LayerId> open;
    bool wasGreeted = false;  ///< also when it is closing now

    [[nodiscard]] bool isGreeted() const { return std::holds_alternative<Greeted>(phase); }
    [[nodiscard]] bool isClosing() const { return std::holds_alternative<Closing>(phase); }
};

/// A part that keeps something for each session.
class SessionListener {
public:
    virtual ~SessionListener() = default;

    /// The session is closing: nothing more is received from it or begun for it.
    virtual void closing(SessionId /*session*/) {}
    /// The connection has ended, and the session is no longer in the table.
    virtual void left(const Session& /*session*/) {}
    /// A session has opened the layer or closed it.
    virtual void openChanged(const LayerId& /*layer*/) {}
};

}  // namespace usdlive::server
