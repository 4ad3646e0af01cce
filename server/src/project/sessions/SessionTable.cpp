// Keeps the sessions and sends control messages to them.
#include "project/sessions/SessionTable.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "project/SharedFrame.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::server {

namespace {

/// True for a session that said hello and is not closing.
bool isClient(const Session& session) {
    return !session.client.value.empty() && !session.isClosing();
}

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
    error.request = requestOf(message);
    error.closing = !error.request;  // a welcome
    return error;
}

}  // namespace

std::optional<std::uint64_t> requestOf(const ControlMessage& message) {
    return std::visit(
        []<class Content>(const Content& content) -> std::optional<std::uint64_t> {
            if constexpr (std::is_same_v<Content, RequestProgress>)
                return std::nullopt;
            else if constexpr (requires { std::optional<std::uint64_t>{content.request}; })
                return content.request;
            else
                return std::nullopt;
        },
        message);
}

std::size_t bytesOf(const std::set<LayerId>& layers) {
    constexpr std::size_t kNodeBytes = 80;
    std::size_t bytes = 0;
    for (const LayerId& layer : layers) bytes += kNodeBytes + layer.value.size();
    return bytes;
}

Session& SessionTable::add(SessionId id) {
    Session& session = sessions_[id];
    session.id = id;
    return session;
}

void SessionTable::end(Session& session) {
    outbox_->close(session.id);
    session.phase = Closing{};
    forgetRequests(session.id);
    listeners_.notify(&SessionListener::closing, session.id);
}

void SessionTable::close(Session& session, const Error& error) {
    send(session, ErrorMessage{std::string(errorName(error.code)), error.message, true, {}, {}});
    end(session);
}

bool SessionTable::remove(SessionId id) {
    const auto left = sessions_.extract(id);
    if (left.empty()) return false;
    forgetRequests(id);
    open_.giveBackAll(id);
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
    return std::size_t(
        std::ranges::count_if(sessions_, [](const auto& one) { return isClient(one.second); }));
}

std::set<UserName> SessionTable::users() const {
    std::set<UserName> users;
    for (const auto& [id, session] : sessions_)
        if (isClient(session) && !session.subject.user.value.empty())
            users.insert(session.subject.user);
    return users;
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

std::optional<Error> SessionTable::whyNotOpen(const Session& session, const LayerId& layer) const {
    if (session.share.empty() || open_.ofGroup(session.share) < userLayers_ ||
        session.open.contains(layer))
        return std::nullopt;
    return Error{ErrorCode::TooManyRequests,
                 "the sessions of " + session.subject.user.value + " have " +
                     std::to_string(userLayers_) +
                     " layers open, which is the limit for one user (--max-user-layers)"};
}

bool SessionTable::open(Session& session, const LayerId& layer) {
    if (!session.open.insert(layer).second) return false;
    open_.take(session.id, 1, session.share);
    listeners_.notify(&SessionListener::openChanged, layer);
    return true;
}

bool SessionTable::closeLayer(Session& session, const LayerId& layer) {
    if (session.open.erase(layer) == 0) return false;
    open_.giveBack(session.id, 1);
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

bool SessionTable::takeForRequest(const Session& session, std::uint64_t request,
                                  std::size_t bytes) {
    requests_[{session.id, request}] += bytes;
    requestBytes_.take(session.id, bytes, session.share);
    const auto over = requestBytes_.givesWay(session.id);
    if (!over) return true;
    close(sessions_.at(*over),
          {ErrorCode::MalformedControl, "too many requests of this session are not answered yet"});
    return *over != session.id;
}

void SessionTable::answered(SessionId session, std::uint64_t request) {
    const auto found = requests_.extract({session, request});
    if (!found.empty()) requestBytes_.giveBack(session, found.mapped());
}

void SessionTable::forgetRequests(SessionId session) {
    requests_.erase(requests_.lower_bound({session, 0}), requests_.lower_bound({session + 1, 0}));
    requestBytes_.giveBackAll(session);
}

void SessionTable::send(const Session& session, const ControlMessage& message) {
    if (const auto request = requestOf(message)) answered(session.id, *request);
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

void SessionTable::sendToSubscribers(const std::string& feature, const StateUpdate& update) {
    std::vector<SessionId> listening;
    for (const auto& [id, session] : sessions_)
        if (session.isGreeted() && session.features.contains(feature)) listening.push_back(id);
    outbox_->sendUpdate(listening, update);
}

}  // namespace usdlive::server
