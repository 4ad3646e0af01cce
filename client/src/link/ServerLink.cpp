// Passes messages between a connection and the session.
#include "link/ServerLink.h"

#include <utility>
#include <variant>

#include "link/AwaitedAnswers.h"

namespace usdlive::client {

namespace {

constexpr std::size_t kMessagesPerTick = 4096;

}  // namespace

void ServerLink::receive(Session& session) {
    for (auto& happening : connection_->poll(kMessagesPerTick))
        std::visit([&](auto& one) { take(one, session); }, happening);
}

void ServerLink::take(Connection::Opened&, Session& session) {
    open_ = true;
    session.connected();
}

void ServerLink::take(Connection::Message& message, Session& session) {
    if (open_) session.received(std::get<ReceivedMessage>(std::move(message.content)));
}

void ServerLink::take(Connection::Lost& lost, Session& session) {
    lastLoss_ = lost.reason;
    if (std::exchange(open_, false)) session.disconnected(std::move(lost.reason), lost.unconfirmed);
}

bool ServerLink::closing(const ErrorMessage& message, Session& session) {
    const bool again = refusal_ && refusal_->message == message.message;
    refusal_ = message;
    Error error = toError(message);
    if (!session.welcome()) refused_ = error;
    hangUp(std::move(error), session);
    return !again;
}

void ServerLink::hangUp(Error reason, Session& session) {
    if (!std::exchange(open_, false)) return;
    connection_->reset();
    lastLoss_ = reason;
    session.disconnected(std::move(reason));
}

}  // namespace usdlive::client
