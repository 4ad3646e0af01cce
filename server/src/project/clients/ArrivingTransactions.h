// Transactions that are received in parts (FR8).
#pragma once

#include <map>
#include <optional>
#include <unordered_set>

#include "project/clients/TransactionSize.h"
#include "project/sessions/Session.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::server {

/// Joins the parts of transactions. The caller bounds their memory. Each part is decoded when it is
/// received, so that other sessions are served between two parts.
class ArrivingTransactions {
public:
    explicit ArrivingTransactions(const TransactionLimits& limits) : limits_(limits) {}

    struct Arrived {
        Transaction transaction;
        std::size_t bytes = 0;  ///< size as received
        /// Set if the transaction is too large; `transaction` then has no edits.
        std::optional<Refused> refused;
    };
    /// Receives a transaction or a part of one. Returns the transaction when its last part has
    /// arrived, or when it has become too large; before that, nothing. After an error, the caller
    /// closes the session.
    Result<std::optional<Arrived>> receive(const Session& session, SubmitFrame frame,
                                           std::size_t bytes);
    /// Drops the session's incomplete transaction.
    void forget(SessionId session) { arriving_.erase(session); }
    /// Returns the size of the received parts of the session.
    [[nodiscard]] std::size_t bytes(SessionId session) const;
    /// Adds the big values that the received parts name.
    void addNamed(std::unordered_set<Hash>& named) const;

private:
    struct Arriving {
        SubmitParts parts;
        std::size_t bytes = 0;  ///< size of the received parts
        std::size_t edits = 0;
        bool refused = false;  ///< the remaining parts are ignored
    };
    TransactionLimits limits_;
    std::map<SessionId, Arriving> arriving_;
};

}  // namespace usdlive::server
