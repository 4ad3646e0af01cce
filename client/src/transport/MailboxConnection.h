// The owner's side of a connection with a mailbox.
#pragma once

#include "transport/Connection.h"
#include "transport/Mailbox.h"

namespace usdlive::client {

/// The owner's side of a connection. It shares a mailbox with the connection's thread.
class MailboxConnection : public Connection {
public:
    void send(SharedBytes frames) final {
        if (!frames || frames->empty()) return;
        switch (mailbox_.queue(std::move(frames))) {
            case Mailbox::Queued::Yes:
                return queued();
            case Mailbox::Queued::Full:
                return drop(mailbox_.seen(), "too many messages wait to be sent");
            case Mailbox::Queued::Dropped:
                return;
        }
    }

    std::vector<Happening> poll(std::size_t most) final {
        bool hasMadeRoom = false;
        auto happenings = mailbox_.fetch(most, hasMadeRoom);
        if (hasMadeRoom) madeRoom();
        return happenings;
    }

    bool wait(std::chrono::milliseconds time) final { return mailbox_.wait(time); }
    [[nodiscard]] std::size_t queuedBytes() const final { return mailbox_.outboxBytes(); }
    [[nodiscard]] std::size_t bulkBytes() const final { return mailbox_.bulkBytes(); }
    [[nodiscard]] std::optional<ServerAddress> web() const override { return address_; }
    void reset() final { drop(mailbox_.seen(), "the connection was reset"); }

protected:
    MailboxConnection(ServerAddress address, Brings brings)
        : address_(std::move(address)), mailbox_(brings) {}

    // Called on the owner's thread when there is something to write, or room for reading.
    virtual void queued() = 0;
    virtual void madeRoom() = 0;
    /// Drops this connection, but not a newer one.
    virtual void drop(std::uint64_t generation, std::string why) = 0;

    [[nodiscard]] std::string where() const {
        ServerAddress server = address_;
        server.layer.clear();
        return server.url();
    }
    /// Returns the error for the loss of an open connection.
    [[nodiscard]] Error lost(const std::string& why) const {
        return {ErrorCode::NotConnected, "lost the connection to " + where() + ": " + why};
    }

    const ServerAddress address_;
    Mailbox mailbox_;
};

}  // namespace usdlive::client
