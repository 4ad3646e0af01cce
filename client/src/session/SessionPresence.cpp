// Presence: where this user and the others are (PS1-PS3).
#include <algorithm>

#include "session/SessionImpl.h"
#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::client {

// The server ends the session over a presence that it cannot read, and would do so again after each
// reconnect.
Result<void> Session::Impl::showPresence(Presence presence) {
    Presence filledIn = presence;  // the form that the server sends to others
    filledIn.client = options_.client;
    filledIn.user = options_.user;
    filledIn.application = options_.application;
    if (auto valid = checkPresence(filledIn); !valid) return valid;
    if (const auto readable = encodeChecked(ShowPresence{presence}); !readable)
        return fail(readable.error().code,
                    "the presence cannot be sent: " + readable.error().message);
    presenceRefusals_ = 0;
    presence_ = std::move(presence);
    return {};
}

// A server of another version may refuse more than this client knows.
void Session::Impl::noteRefusedPresence(ErrorCode closing) {
    constexpr int kMost = 2;
    if (closing == ErrorCode::MalformedControl && presenceSent_ && ++presenceRefusals_ >= kMost)
        presence_.reset();
}

void Session::Impl::hidePresence() { presence_.reset(); }

void Session::Impl::sendPresence() {
    const auto& features = welcome_->features;
    if (!presence_ || std::find(features.begin(), features.end(), "presence") == features.end())
        return;
    const bool changed = presenceSent_ != presence_;
    const std::int64_t pause = changed ? 1'000 / kPresencesPerSecond : kPresenceRepeatMs;
    if (presenceSent_ && nowMs_ - presenceSentMs_ < pause) return;
    presenceSentMs_ = nowMs_;
    presenceSent_ = presence_;
    sendControl(ShowPresence{*presence_});
}

void Session::Impl::on(const Presences& message) {
    event::PresenceChanged changed;
    for (const Presence& shown : message.shown) {
        if (shown.client == options_.client) continue;
        presences_[shown.client] = shown;
        changed.shown.push_back(shown);
    }
    for (const ClientId& gone : message.gone)
        if (presences_.erase(gone) > 0) changed.gone.push_back(gone);
    if (!changed.shown.empty() || !changed.gone.empty()) events_.push_back(std::move(changed));
}

/// Without a connection, the presences of others are unknown.
void Session::Impl::forgetOthers() {
    presenceSent_.reset();
    event::PresenceChanged changed;
    for (const auto& [client, presence] : std::exchange(presences_, {}))
        changed.gone.push_back(client);
    if (!changed.gone.empty()) events_.push_back(std::move(changed));
}

}  // namespace usdlive::client
