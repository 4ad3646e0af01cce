// The table of a project's sessions.
#pragma once

#include <map>
#include <optional>
#include <utility>

#include "project/PublicText.h"
#include "project/Wiring.h"
#include "project/sessions/Session.h"
#include "usdlive/common/core/Budget.h"

namespace usdlive::server {

/// Returns the number of the request that the message is, or that it answers.
[[nodiscard]] std::optional<std::uint64_t> requestOf(const ControlMessage& message);
/// Returns the memory of a set of names, about.
[[nodiscard]] std::size_t bytesOf(const std::set<LayerId>& layers);

/// The connected sessions and the layers that they have open. Sends control messages and closes
/// sessions.
class SessionTable {
public:
    struct Limits {
        Budget<SessionId>::Limits requestBytes;
        std::size_t userLayers = 0;  ///< that the sessions of a user have open together
    };
    SessionTable(ports::Outbox& outbox, const PublicText& texts, const Limits& limits)
        : outbox_(outbox),
          texts_(texts),
          userLayers_(limits.userLayers),
          requestBytes_(limits.requestBytes) {}

    /// Listeners are notified in the order in which they are added.
    void addListener(SessionListener& listener) { listeners_.add(listener); }

    Session& add(SessionId id);
    /// Closes the session after its queued messages were sent.
    void end(Session& session);
    /// Sends the error, then closes the session.
    void close(Session& session, const Error& error);
    /// Removes a session whose connection has ended. Returns false for an unknown session.
    bool remove(SessionId id);

    [[nodiscard]] Session* find(SessionId id);
    [[nodiscard]] const Session* find(SessionId id) const;
    /// Returns nullptr if there is no such session, if it has no welcome yet, or if it is closing.
    [[nodiscard]] Session* greeted(SessionId id);
    [[nodiscard]] std::map<SessionId, Session>& all() { return sessions_; }
    [[nodiscard]] const std::map<SessionId, Session>& all() const { return sessions_; }
    /// Returns the number of sessions that said hello and are not closing.
    [[nodiscard]] std::size_t clients() const;
    /// Returns the users of these sessions.
    [[nodiscard]] std::set<UserName> users() const;
    /// Returns whether the user has a session.
    [[nodiscard]] bool isUserConnected(const UserName& user) const;
    [[nodiscard]] bool isConnected(const ClientId& client) const;

    /// Returns why the session may not open the layer (SE22); nothing if it may, or has it open.
    [[nodiscard]] std::optional<Error> whyNotOpen(const Session& session,
                                                  const LayerId& layer) const;
    /// Opens or closes a layer for the session. Returns false if nothing changed.
    bool open(Session& session, const LayerId& layer);
    bool closeLayer(Session& session, const LayerId& layer);
    [[nodiscard]] bool isOpen(const LayerId& layer) const;
    /// Returns the users that have the layer open.
    [[nodiscard]] std::set<UserName> editors(const LayerId& layer) const;

    /// Notes that a request takes `bytes` more until it is answered. Closes the session that gives
    /// way if that is too much (SE22); false: it is this one.
    bool takeForRequest(const Session& session, std::uint64_t request, std::size_t bytes);
    /// Returns what the unanswered requests of all sessions take.
    [[nodiscard]] std::size_t requestBytes() const { return requestBytes_.used(); }

    /// Sends a message. Its texts name no folder of the machine (FR12). An answer ends its request.
    void send(const Session& session, const ControlMessage& message);
    void sendError(const Session& session, const Error& error,
                   std::optional<std::uint64_t> request = {}, std::optional<Hash> blob = {});
    /// Sends the update to each session that asked for the feature.
    void sendToSubscribers(const std::string& feature, const StateUpdate& update);
    /// Returns the error as clients may see it.
    [[nodiscard]] Error shown(const Error& error) const { return (*texts_)(error); }

private:
    void answered(SessionId session, std::uint64_t request);
    void forgetRequests(SessionId session);

    Wire<ports::Outbox> outbox_;
    Wire<const PublicText> texts_;
    Listeners<SessionListener> listeners_;
    std::map<SessionId, Session> sessions_;
    std::size_t userLayers_;
    Budget<SessionId> open_;  // layers
    Budget<SessionId> requestBytes_;
    std::map<std::pair<SessionId, std::uint64_t>, std::size_t> requests_;  // bytes; unanswered
};

}  // namespace usdlive::server
