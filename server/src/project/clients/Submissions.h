// The transactions that sessions submit, until they are ordered or refused.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <unordered_set>
#include <vector>

#include "project/Wiring.h"
#include "project/access/AccessPolicy.h"
#include "project/clients/ArrivingTransactions.h"
#include "project/clients/Authors.h"
#include "project/clients/Prerequisites.h"
#include "project/stream/Catchup.h"
#include "project/stream/Gestures.h"

namespace usdlive::server {

/// The queue of transactions of each session, in the order of submission. The first one is executed
/// when all data that it needs is in memory; the others wait for it.
class Submissions : public LineListener, public LayerListener, public SessionListener {
public:
    struct Parts {
        HistoryLine& line;
        const StoreCondition& store;
        SessionTable& sessions;
        Authors& authors;
        Prerequisites& prerequisites;
        Catchup& catchup;
        Gestures& gestures;
        const AccessPolicy& access;
        ports::Activity& activity;
    };
    Submissions(const TransactionLimits& limits, const Parts& parts, ProjectCounters& counters);

    void receive(Session& session, SubmitFrame frame, std::size_t bytes);
    /// Continues with the session's transactions, after data for which they may wait has arrived.
    void work(SessionId session);
    void workAll();
    /// Receives the commit of the transaction `sequence` of the session's client, read from the
    /// store.
    void creationsRead(SessionId session, std::uint64_t sequence,
                       const Result<std::vector<StoredCommit>>& commits);

    [[nodiscard]] bool isWaiting(SessionId session) const;
    /// Returns whether a waiting transaction edits the layer.
    [[nodiscard]] bool needs(const LayerId& layer) const;
    /// Adds the big values that waiting transactions name.
    void addNamed(std::unordered_set<Hash>& named) const;

    void becameDurable(Revision upTo) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void ready(const LayerId& /*layer*/, bool /*imported*/) override { workAll(); }
    void failed(const LayerId& /*layer*/, const Error& /*error*/) override { workAll(); }
    void closing(SessionId session) override;
    void left(const Session& session) override;

private:
    /// SE21: transactions that were refused for a reason that passes. All transactions of the
    /// session are refused until one of these is submitted again.
    struct Held {
        Error reason;
        std::set<std::uint64_t> sequences;
    };
    struct Queue {
        std::deque<QueuedTransaction> transactions;
        std::size_t bytes = 0;
        std::optional<Held> held;
    };
    void add(Session& session, Transaction transaction, std::size_t bytes);
    [[nodiscard]] bool fits(const Session& session);
    void measure(const Session& session);
    bool handle(const Session& session, QueuedTransaction& queued);
    [[nodiscard]] std::optional<Refused> heldBack(SessionId session, std::uint64_t sequence);
    void hold(const Session& session, std::uint64_t sequence, const Error& reason);
    [[nodiscard]] std::optional<Refused> objection(const Author& author,
                                                   const QueuedTransaction& queued) const;
    void execute(const Session& session, Author& author, const QueuedTransaction& queued);
    void refuse(const Session& session, const Transaction& transaction, const Refused& refused);

    TransactionLimits limits_;
    Wire<HistoryLine> line_;
    Wire<const StoreCondition> store_;
    Wire<SessionTable> sessions_;
    Wire<Authors> authors_;
    Wire<Prerequisites> prerequisites_;
    Wire<Catchup> catchup_;
    Wire<Gestures> gestures_;
    Wire<const AccessPolicy> access_;
    Wire<ports::Activity> activity_;
    Wire<ProjectCounters> counters_;

    ArrivingTransactions arriving_;
    std::map<SessionId, Queue> queues_;
    Budget<SessionId> received_;           ///< bytes of parts and of queued transactions
    std::deque<LostSubmission> inFlight_;  ///< ordered, not durable yet; sorted by revision
};

}  // namespace usdlive::server
