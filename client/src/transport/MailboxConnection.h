#pragma once

#include "Mailbox.h"
#include "usdlive/client/transport/Connection.h"

namespace usdlive::client {

/// The owner's side of a connection whose thread it shares a mailbox with.
class MailboxConnection : public Connection {
public:
    void send(SharedBytes frames) final {
        if (!frames || frames->empty()) return;
        switch (mailbox_.queue(std::move(frames))) {
            case Mailbox::Queued::Yes:
                return queued();
            case Mailbox::Queued::Full:
                return drop(mailbox_.seen(), "it takes nothing any more");
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
    void reset() final { drop(mailbox_.seen(), "the connection was reset"); }

protected:
    MailboxConnection(ServerAddress address, Brings brings)
        : address_(std::move(address)), mailbox_(brings) {}

    // On the owner's thread: there is something to write; there is room to read on.
    virtual void queued() = 0;
    virtual void madeRoom() = 0;
    /// A connection that is newer than the one meant is left alone.
    virtual void drop(std::uint64_t generation, std::string why) = 0;

    [[nodiscard]] std::string where() const {
        ServerAddress server = address_;
        server.layer.clear();
        return server.url();
    }
    /// What is told of a connection that was open.
    [[nodiscard]] Error lost(const std::string& why) const {
        return {ErrorCode::NotConnected, "lost the connection to " + where() + ": " + why};
    }

    const ServerAddress address_;
    Mailbox mailbox_;
};

}  // namespace usdlive::client
