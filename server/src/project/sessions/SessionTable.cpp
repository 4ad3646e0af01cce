// Keeps the sessions and sends control messages to them.
#include "sessions/SessionTable.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "usdlive/common/protocol/ServerControl.h"
#include "usdlive/server/project/SharedFrame.h"

namespace usdlive::server {

namespace {

/// Changes the texts of a message. Ids and hashes are no texts.
template <class T>
void showTexts(const PublicText& texts, T& value) {
    if constexpr (std::is_same_v<T, std::string>)
        value = texts(std::move(value));
    else if constexpr (HasFields<T>)
        forEachField(value, [&](std::string_view, auto& field) { showTexts(texts, field); });
    else if constexpr (requires { value.emplace_back(); })
        for (auto& element : value) showTexts(texts, element);
}

/// A client would end the session over a message that is larger.
ErrorMessage tooLarge(const ControlMessage& message) {
    ErrorMessage error{std::string(errorName(ErrorCode::Internal)),
                       "the answer is larger than a message may be: ask for less at once",
                       false,
                       {},
                       {}};
    std::visit(
        [&](const auto& content) {
            if constexpr (requires { std::uint64_t{content.request}; })
                error.request = content.request;
        },
        message);
    error.closing = !error.request;  // a welcome
    return error;
}

}  // namespace

Session& SessionTable::add(SessionId id) {
    Session& session = sessions_[id];
    session.id = id;
    return session;
}

void SessionTable::end(Session& session) {
    outbox_->close(session.id);
    session.phase = Closing{};
    listeners_.notify(&SessionListener::closing, session.id);
}

void SessionTable::close(Session& session, const Error& error) {
    send(session, ErrorMessage{std::string(errorName(error.code)), error.message, true, {}, {}});
    end(session);
}

bool SessionTable::remove(SessionId id) {
    const auto left = sessions_.extract(id);
    if (left.empty()) return false;
    listeners_.notify(&SessionListener::left, left.mapped());
    for (const LayerId& layer : left.mapped().open)
        listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

Session* SessionTable::find(SessionId id) {
    const auto found = sessions_.find(id);
    return found == sessions_.end() ? nullptr : &found->second;
}

const Session* SessionTable::find(SessionId id) const {
    const auto found = sessions_.find(id);
    return found == sessions_.end() ? nullptr : &found->second;
}

Session* SessionTable::greeted(SessionId id) {
    Session* session = find(id);
    return session && session->isGreeted() ? session : nullptr;
}

std::size_t SessionTable::clients() const {
    return std::size_t(std::ranges::count_if(sessions_, [](const auto& one) {
        return !one.second.client.value.empty() && !one.second.isClosing();
    }));
}

bool SessionTable::isUserConnected(const UserName& user) const {
    return std::ranges::any_of(sessions_, [&](const auto& one) {
        return one.second.isGreeted() && one.second.subject.user == user;
    });
}

bool SessionTable::isConnected(const ClientId& client) const {
    return std::ranges::any_of(sessions_,
                               [&](const auto& one) { return one.second.client == client; });
}

bool SessionTable::open(Session& session, const LayerId& layer) {
    if (!session.open.insert(layer).second) return false;
    listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

bool SessionTable::closeLayer(Session& session, const LayerId& layer) {
    if (session.open.erase(layer) == 0) return false;
    listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

bool SessionTable::isOpen(const LayerId& layer) const {
    return std::ranges::any_of(sessions_,
                               [&](const auto& one) { return one.second.open.contains(layer); });
}

std::set<UserName> SessionTable::editors(const LayerId& layer) const {
    std::set<UserName> editors;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.open.contains(layer))
            editors.insert(session.subject.user);
    return editors;
}

void SessionTable::send(const Session& session, const ControlMessage& message) {
    ControlMessage shown = message;
    std::visit([this](auto& content) { showTexts(*texts_, content); }, shown);
    std::string json = encodeControl(shown);
    if (json.size() > kMaxServerControlBytes) json = encodeControl(tooLarge(shown));
    outbox_->send(session.id, sharedFrame(ControlFrame{std::move(json)}));
}

void SessionTable::sendError(const Session& session, const Error& error,
                             std::optional<std::uint64_t> request, std::optional<Hash> blob) {
    send(session,
         ErrorMessage{std::string(errorName(error.code)), error.message, false, request, blob});
}

void SessionTable::sendToAll(const ControlMessage& message) {
    const SharedBytes frame = sharedFrame(message);
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted()) outbox_->send(id, frame);
}

void SessionTable::sendToSubscribers(const std::string& feature, const StateUpdate& update) {
    std::vector<SessionId> listening;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.features.contains(feature)) listening.push_back(id);
    outbox_->sendUpdate(listening, update);
}

}  // namespace usdlive::server
