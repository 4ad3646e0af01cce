// Transactions that come in parts (FR8).
#pragma once

#include <map>
#include <optional>
#include <unordered_set>

#include "clients/TransactionSize.h"
#include "sessions/Session.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

/// Joins the parts of transactions. Parts are decoded as they come, so that other sessions are
/// served between two of them.
class ArrivingTransactions {
public:
    explicit ArrivingTransactions(const TransactionLimits& limits) : limits_(limits) {}

    struct Arrived {
        Transaction transaction;
        std::size_t bytes = 0;           ///< as it came
        std::optional<Refused> refused;  ///< it is too large; it has no edits here
    };
    /// Returns the transaction with its last part, or when it becomes too large; nothing before.
    /// An error ends the session.
    Result<std::optional<Arrived>> receive(const Session& session, SubmitFrame frame,
                                           std::size_t bytes);
    /// The session's transaction will not become whole.
    void forget(SessionId session);
    /// Adds the big values that the parts name.
    void addNamed(std::unordered_set<Hash>& named) const;

private:
    struct Arriving {
        SubmitParts parts;
        std::size_t bytes = 0;  ///< of the parts so far
        std::size_t edits = 0;
        bool refused = false;  ///< the parts that still come are passed over
    };
    TransactionLimits limits_;
    std::map<SessionId, Arriving> arriving_;
    std::uint64_t bytes_ = 0;  ///< of all sessions' parts
};

}  // namespace usdlive::server
