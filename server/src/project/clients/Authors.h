// The clients of the project and their committed transactions.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <unordered_map>

#include "project/Wiring.h"
#include "project/clients/CommittedNumbers.h"
#include "project/lines/HistoryLine.h"
#include "project/lines/StoreCondition.h"
#include "project/ports/History.h"
#include "project/sessions/SessionTable.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::server {

/// A client and its transactions, over all its connections.
struct Author {
    OwnCreations creations;
    std::map<std::uint64_t, Revision> inFlight;  ///< by number: ordered, not durable yet
    Revision newest = 0;                         ///< the client's newest commit, as far as known
    std::optional<CommittedNumbers> committed;   ///< nothing: not read from the store yet
    bool isBeingRead = false;                    ///< the store is reading them

    /// Returns the revision of a committed transaction (M9). Precondition: `committed` is set.
    [[nodiscard]] std::optional<Revision> revisionOf(std::uint64_t sequence) const {
        const auto found = inFlight.find(sequence);
        return found != inFlight.end() ? found->second : committed->find(sequence);
    }
};

/// The clients that are connected or whose commits are not durable yet. Reads the committed
/// transactions of a client (M9) from the store when it connects, and keeps them while it is
/// connected.
class Authors : public LineListener, public SessionListener {
public:
    Authors(const SessionTable& sessions, const StoreCondition& store, ports::History& history,
            Revision forgottenUpTo)
        : sessions_(sessions), store_(store), history_(history), forgottenUpTo_(forgottenUpTo) {}

    [[nodiscard]] Author& of(const ClientId& client) { return authors_[client]; }
    /// Requests the client's transactions from the store, unless they are known or requested.
    void read(const ClientId& client);
    /// Receives the answer of the store. Returns false if it was not requested.
    bool answered(const ClientId& client, const Result<ClientRecord>& record);
    /// Forgets a client that is not connected and has no commit in flight. Its transactions are
    /// read from the store again when it reconnects.
    void forgetIfUnused(const ClientId& client);

    /// The store has forgotten clients whose last commit is not newer than `upTo` (M14).
    void clientsForgotten(Revision upTo) { forgottenUpTo_ = std::max(forgottenUpTo_, upTo); }
    [[nodiscard]] Revision forgottenUpTo() const { return forgottenUpTo_; }
    /// Returns the clients that the store must not forget.
    [[nodiscard]] std::set<ClientId> active() const;

    void durable(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void left(const Session& session) override;

private:
    Wire<const SessionTable> sessions_;
    Wire<const StoreCondition> store_;
    Wire<ports::History> history_;
    std::unordered_map<ClientId, Author> authors_;
    Revision forgottenUpTo_;
};

}  // namespace usdlive::server
