// The clients that commit.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <unordered_map>

#include "Wiring.h"
#include "clients/CommittedNumbers.h"
#include "lines/HistoryLine.h"
#include "lines/StoreCondition.h"
#include "sessions/SessionTable.h"
#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/server/project/ports/History.h"

namespace usdlive::server {

/// A client, over all its connections.
struct Author {
    OwnCreations creations;
    std::map<std::uint64_t, Revision> inFlight;  ///< by sequence: ordered and not durable yet
    Revision newest = 0;                         ///< of its commits, as far as known
    std::optional<CommittedNumbers> committed;   ///< nothing: not known yet
    bool isBeingRead = false;                    ///< the store is being asked for them

    /// M9. Precondition: `committed` is known.
    [[nodiscard]] std::optional<Revision> revisionOf(std::uint64_t sequence) const {
        const auto found = inFlight.find(sequence);
        return found != inFlight.end() ? found->second : committed->find(sequence);
    }
};

/// The clients that are connected, and those whose commits are not durable yet. What a client has
/// committed (M9) is asked of the store when it comes, and kept while it is here.
class Authors : public LineListener, public SessionListener {
public:
    Authors(const SessionTable& sessions, const StoreCondition& store, ports::History& history,
            Revision forgottenUpTo)
        : sessions_(sessions), store_(store), history_(history), forgottenUpTo_(forgottenUpTo) {}

    [[nodiscard]] Author& of(const ClientId& client) { return authors_[client]; }
    /// Asks the store what the client has committed, unless that is known or asked for.
    void read(const ClientId& client);
    /// The answer. False: nobody waits for it.
    bool answered(const ClientId& client, const Result<ClientRecord>& record);
    /// Forgets a client that is not here and has nothing under way. What it has committed is asked
    /// of the store when it comes back.
    void forgetIfUnused(const ClientId& client);

    /// The store has forgotten clients whose last commit is this one or an earlier one (M14).
    void clientsForgotten(Revision upTo) { forgottenUpTo_ = std::max(forgottenUpTo_, upTo); }
    [[nodiscard]] Revision forgottenUpTo() const { return forgottenUpTo_; }
    /// The clients that the store must not forget.
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
