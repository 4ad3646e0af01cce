// Passes messages between a connection and the session.
#include "link/ServerLine.h"

#include <utility>
#include <variant>

#include "link/Answers.h"

namespace usdlive::client {

namespace {

constexpr std::size_t kMessagesPerTick = 4096;

}  // namespace

void ServerLine::receive(Session& session) {
    for (auto& happening : connection_->poll(kMessagesPerTick))
        std::visit([&](auto& one) { take(one, session); }, happening);
}

void ServerLine::take(Connection::Opened&, Session& session) {
    open_ = true;
    session.connected();
}

void ServerLine::take(Connection::Message& message, Session& session) {
    if (open_) session.received(std::get<ReceivedMessage>(std::move(message.content)));
}

void ServerLine::take(Connection::Lost& lost, Session& session) {
    lastLoss_ = lost.reason;
    if (std::exchange(open_, false)) session.disconnected(std::move(lost.reason), lost.unconfirmed);
}

bool ServerLine::closing(const ErrorMessage& message, Session& session) {
    const bool again = refusal_ && refusal_->message == message.message;
    refusal_ = message;
    Error error = toError(message);
    if (!session.welcome()) refused_ = error;
    hangUp(std::move(error), session);
    return !again;
}

void ServerLine::hangUp(Error reason, Session& session) {
    if (!std::exchange(open_, false)) return;
    connection_->reset();
    lastLoss_ = reason;
    session.disconnected(std::move(reason));
}

}  // namespace usdlive::client
