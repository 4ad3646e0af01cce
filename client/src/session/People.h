// Presence: where this user and the others are (PS1-PS3).
#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "session/Channel.h"
#include "session/SessionEvents.h"

namespace usdlive::client {

/// The presence of this client, which others see, and those of the others.
class People {
public:
    People(const Session::Options& options, Channel& channel, SessionEvents& events)
        : options_(options), channel_(channel), events_(events) {}

    /// Errors: those of encodeChecked() and checkPresence(). The presence shown before stays.
    Result<void> show(Presence presence);
    void hide() { own_.reset(); }
    /// Sends the own presence if it has changed or has to be repeated.
    void send(std::int64_t nowMs);
    /// The server has ended the connection with this error. A server of another version may refuse
    /// more presences than this client knows of: one that it refuses again is not sent any more.
    void connectionRefused(ErrorCode why);

    void received(const Presences& message);
    /// Without a connection, the presences of others are unknown.
    void disconnected();
    [[nodiscard]] const std::map<ClientId, Presence>& others() const { return others_; }

private:
    const Session::Options& options_;
    Channel& channel_;
    SessionEvents& events_;

    std::optional<Presence> own_;
    std::optional<Presence> sent_;  // on this connection
    std::int64_t sentMs_ = 0;
    int refusals_ = 0;  // connections that ended after it was sent
    std::map<ClientId, Presence> others_;
};

}  // namespace usdlive::client
