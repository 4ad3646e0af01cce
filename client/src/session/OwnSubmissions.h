// Own transactions on their way to the server.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "session/BlobTransfer.h"
#include "session/Channel.h"
#include "session/Deadline.h"
#include "session/OwnAddresses.h"
#include "session/SessionEvents.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

/// Sends own transactions in order, large ones in parts (FR8), and waits when the server refuses
/// them for a reason that passes (SE21).
class OwnSubmissions {
public:
    OwnSubmissions(const Session::Options& options, SessionHost& host, Channel& channel,
                   BlobUploads& uploads, PendingTransactions& pending, OwnAddresses& addresses,
                   const Deadline& deadline, SessionEvents& events)
        : options_(options),
          host_(host),
          channel_(channel),
          uploads_(uploads),
          pending_(pending),
          addresses_(addresses),
          deadline_(deadline),
          events_(events) {}

    /// A transaction that the server can never take.
    using TooLarge = std::pair<std::uint64_t, Error>;
    /// Sends what may be sent, until the deadline. `known`: the specs that the transactions touch
    /// are known. Returns those that the caller has to take out.
    [[nodiscard]] std::vector<TooLarge> send(std::int64_t nowMs, bool known);
    /// Returns whether the last send() ended because of the deadline.
    [[nodiscard]] bool hasMore() const { return hasMore_; }

    /// The server has refused a transaction for a reason that passes. It stays pending.
    void hold(std::uint64_t sequence, const Error& reason, std::int64_t nowMs);
    /// The server has answered a transaction otherwise.
    void answered() { held_.reset(); }
    /// The addresses of all transactions change: one that was sent in part is sent again.
    void restart();
    void disconnected();

private:
    // A transaction of which some parts have been sent.
    struct Partial {
        std::uint64_t sequence = 0;
        PartsAt at;
    };
    struct Held {
        std::int64_t pauseMs = 0;
        std::int64_t untilMs = 0;  // nothing is sent before
        bool tried = false;        // one of them was sent again
    };

    void sendWhole(bool known, std::vector<TooLarge>& tooLarge);
    [[nodiscard]] bool sendParts(std::vector<TooLarge>& tooLarge);

    const Session::Options& options_;
    SessionHost& host_;
    Channel& channel_;
    BlobUploads& uploads_;
    PendingTransactions& pending_;
    OwnAddresses& addresses_;
    const Deadline& deadline_;
    SessionEvents& events_;

    std::optional<Partial> partial_;
    std::optional<Held> held_;
    bool hasMore_ = false;
};

}  // namespace usdlive::client
