// Sends the unsent transactions of an ended connection.
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
#include "usdlive/common/layer/TransactionExecutor.h"
#include "values/BlobCache.h"
#include "work/Journal.h"

namespace usdlive::client {

/// Sends the unsent transactions of a connection that has ended, exactly once.
///
/// A separate session uses the client id of that connection and sends each transaction with its old
/// sequence number (M9). Transactions that the log already contains are skipped. The paths of the
/// others are carried forward over the moves and deletes that others have committed meanwhile (M3).
class UnsentSender final : public SessionHost, public LayerView {
public:
    /// `journal` and `blobs` outlive this object. `options` are those of the session, with the
    /// journal's client id.
    UnsentSender(Connection& connection, Session::Options options, LeftJournal& journal,
                 BlobSource& blobs);

    /// Blocks until all transactions are answered. Errors: HistoryDiverged (the project has another
    /// history, or one that begins later); NotConnected, or an error that passes (errorPasses()),
    /// such as StorageFull: the time is over. Unanswered transactions then stay in the journal and
    /// can be sent again.
    [[nodiscard]] Result<SentWork> send(double timeoutMs);

    /// Returns the refused and dropped edits, also after send() has failed.
    [[nodiscard]] std::vector<LostWork> takeLost() { return std::move(lost_); }

    // SessionHost
    void send(SharedBytes frames) override { connection_.send(std::move(frames)); }
    std::size_t bulkBytes() override;
    SharedBytes localBlob(const Hash& hash) override;
    bool holdsBlob(const Hash& hash) override;
    void blobArrived(const Hash&, SharedBytes, bool) override {}
    void pending(const PendingWork& work) override;
    void answered(std::uint64_t sequence) override { done_.push_back(sequence); }

    // LayerView: no editor shows these layers.
    void reset(const LayerId&, const LayerDoc&) override {}
    void apply(const LayerId&, const std::string&, const EditAction&) override {}

private:
    using Clock = std::chrono::steady_clock;

    Result<void> waitFor(const char* what, const std::function<bool()>& done);
    void work();
    void take(Event& event);
    [[nodiscard]] Error stays(const Error& reason) const;
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
    BlobSource& blobs_;
    const ClientId client_;
    Session session_;

    Clock::time_point end_;
    bool open_ = false;
    std::optional<Error> failure_;
    std::optional<Error> delay_;  // the newest reason why it takes longer
    // Hashes of the chain at the revisions of the journal's transactions.
    std::map<Revision, Hash> wanted_;
    std::set<std::uint64_t> committed_;
    NamespaceLog moves_;  // the moves and deletes of others
    std::map<LayerId, Error> missing_;
    std::vector<std::uint64_t> done_;
    std::uint64_t nextFree_ = 1;  // higher than all numbers of the journal
    SentWork sent_;
    std::vector<LostWork> lost_;
};

}  // namespace usdlive::client
