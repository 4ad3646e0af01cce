// Shows the own presence, and follows those of others.
#include "session/People.h"

#include "usdlive/common/protocol/CheckedControl.h"

namespace usdlive::client {

// The server ends the session over a presence that it cannot read, and would do so again after each
// reconnect.
Result<void> People::show(Presence presence) {
    Presence filledIn = presence;  // the form that the server sends to others
    filledIn.client = options_.client;
    filledIn.user = options_.user;
    filledIn.application = options_.application;
    if (auto valid = checkPresence(filledIn); !valid) return valid;
    if (const auto readable = encodeChecked(ShowPresence{presence}); !readable)
        return fail(readable.error().code,
                    "the presence cannot be sent: " + readable.error().message);
    refusals_ = 0;
    own_ = std::move(presence);
    return {};
}

void People::connectionRefused(ErrorCode why) {
    constexpr int kMost = 2;
    if (why == ErrorCode::MalformedControl && sent_ && ++refusals_ >= kMost) own_.reset();
}

void People::send(std::int64_t nowMs) {
    if (!own_ || !channel_.knows("presence")) return;
    const bool changed = sent_ != own_;
    const std::int64_t pause = changed ? 1'000 / kPresencesPerSecond : kPresenceRepeatMs;
    if (sent_ && nowMs - sentMs_ < pause) return;
    sentMs_ = nowMs;
    sent_ = own_;
    channel_.send(ShowPresence{*own_});
}

void People::received(const Presences& message) {
    event::PresenceChanged changed;
    for (const Presence& shown : message.shown) {
        if (shown.client == options_.client) continue;
        others_[shown.client] = shown;
        changed.shown.push_back(shown);
    }
    for (const ClientId& gone : message.gone)
        if (others_.erase(gone) > 0) changed.gone.push_back(gone);
    if (!changed.shown.empty() || !changed.gone.empty()) events_.push(std::move(changed));
}

void People::disconnected() {
    sent_.reset();
    event::PresenceChanged changed;
    for (const auto& [client, presence] : std::exchange(others_, {}))
        changed.gone.push_back(client);
    if (!changed.gone.empty()) events_.push(std::move(changed));
}

}  // namespace usdlive::client
