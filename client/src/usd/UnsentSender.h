#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "session/Session.h"
#include "transport/Connection.h"
#include "usd/BlobCache.h"
#include "usd/Journal.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// Sends the work of a connection that has ended, exactly once.
///
/// The work keeps its name: a session of its own takes up the client id of the connection that
/// made it and sends each transaction under its old sequence number (M9). What is in the log by
/// that id already is passed over; the rest is addressed anew, carried through the moves and
/// deletes that others committed meanwhile (M3).
class UnsentSender final : public SessionHost, public LayerView {
public:
    /// `journal` and `blobs` outlive this; `options` are those of the session, with the journal's
    /// client id.
    UnsentSender(Connection& connection, Session::Options options, LeftJournal& journal,
                 usd::BlobSource& blobs);

    /// Blocks until all is answered. NotConnected: the time is over; HistoryDiverged: the project
    /// is another one, or its history does not reach back that far. What is not answered then stays
    /// in the journal, and can be sent again.
    [[nodiscard]] Result<SentWork> send(double timeoutMs);

    /// What was refused or dropped, also when send() has failed.
    [[nodiscard]] std::vector<LostWork> takeLost() { return std::move(lost_); }

    // SessionHost
    void send(SharedBytes frames) override { connection_.send(std::move(frames)); }
    bool takesMore() override;
    SharedBytes localBlob(const Hash& hash) override;
    bool holdsBlob(const Hash& hash) override;
    void blobArrived(const Hash&, SharedBytes, bool) override {}
    void pending(const PendingWork& work) override;
    void answered(std::uint64_t sequence) override { done_.push_back(sequence); }

    // LayerView: nobody looks at it.
    void reset(const LayerId&, const LayerDoc&) override {}
    void apply(const LayerId&, const std::string&, const EditAction&) override {}

private:
    using Clock = std::chrono::steady_clock;

    Result<void> waitFor(const char* what, const std::function<bool()>& done);
    void work();
    void take(Event& event);
    Result<void> readLog();
    Result<void> openLayers();
    Result<void> authorAll();
    void author(const JournaledWork& work);
    Result<void> finishBatch();
    void note(const Commit& commit);
    [[nodiscard]] Result<AuthoredEdit> carried(const AuthoredEdit& edit, Revision since) const;

    Connection& connection_;
    LeftJournal& journal_;
    BlobCache ownBlobs_;
    usd::BlobSource& blobs_;
    const ClientId client_;
    Session session_;

    Clock::time_point end_;
    bool open_ = false;
    std::optional<Error> failure_;
    std::optional<Error> lastLoss_;
    std::map<Revision, Hash> wanted_;  // the chain hashes that the journal's work was made on
    std::set<std::uint64_t> committed_;
    NamespaceLog moves_;  // of others
    std::map<LayerId, Error> missing_;
    std::vector<std::uint64_t> done_;
    std::uint64_t nextFree_ = 1;  // above all numbers of the journal
    SentWork sent_;
    std::vector<LostWork> lost_;
};

}  // namespace usdlive::client
