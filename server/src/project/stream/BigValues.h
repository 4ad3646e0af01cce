// Big values (V9), which are sent beside the stream and stored before a transaction names them.
#pragma once

#include <functional>
#include <map>
#include <unordered_set>
#include <vector>

#include "project/Wiring.h"
#include "project/lines/LineListener.h"
#include "project/lines/StoreCondition.h"
#include "project/sessions/SessionTable.h"
#include "project/stream/KnownBlobs.h"
#include "project/stream/Previews.h"
#include "project/stream/UnusedBlobs.h"

namespace usdlive::server {

/// Receives uploads of big values, sends values on request, and keeps which values are stored and
/// which are unused.
class BigValues : public LineListener, public SessionListener {
public:
    struct Limits {
        std::uint64_t maxBytes = 4ull << 30;      ///< limit of one value
        std::int64_t keepUnusedMs = 15 * 60'000;  ///< B6: unused values are kept for this time
    };
    BigValues(const Limits& limits, SessionTable& sessions, const StoreCondition& store,
              Previews& previews, ports::Blobs& blobs, ports::Outbox& outbox)
        : limits_(limits),
          sessions_(sessions),
          store_(store),
          previews_(previews),
          blobs_(blobs),
          outbox_(outbox) {}

    void request(Session& session, const RequestBlob& request);
    void receive(Session& session, BlobFrame part);

    [[nodiscard]] const Limits& limits() const { return limits_; }
    [[nodiscard]] bool isStored(const Hash& hash) const { return known_.has(hash); }
    /// Returns whether the store is being asked for the value.
    [[nodiscard]] bool isSought(const Hash& hash) const { return known_.isAsked(hash); }
    /// Asks the store whether it has the values.
    void seek(std::vector<Hash> hashes);

    /// Returns the values that the store may drop (B6). `unnamed` are the values that its history
    /// does not name. `named` are those that unexecuted transactions name.
    struct Round {
        const std::vector<Hash>& unnamed;
        Revision upTo = 0;
        std::int64_t nowMs = 0;
        const std::unordered_set<Hash>& named;
    };
    [[nodiscard]] std::vector<Hash> takeUnused(const Round& round);

    // Answers of ports::Blobs.
    void found(const std::vector<Hash>& asked, const std::vector<Hash>& stored);
    void written(SessionId session, const Hash& hash, const Result<bool>& whole);

    void ordered(const OrderedCommit& commit) override;
    void rolledBack(const Error& error, const LostCommits& lost) override;
    void left(const Session& session) override;

private:
    void answer(const Session& session, const RequestBlob& request);
    void sendStored(const Session& session, const Hash& hash);

    Limits limits_;
    Wire<SessionTable> sessions_;
    Wire<const StoreCondition> store_;
    Wire<Previews> previews_;
    Wire<ports::Blobs> blobs_;
    Wire<ports::Outbox> outbox_;

    KnownBlobs known_;
    UnusedBlobs unused_;
    /// Requests of each session for values that the store is being asked for.
    std::map<SessionId, std::vector<RequestBlob>> requests_;
    std::unordered_set<SessionId> uploading_;  ///< sessions that have uploaded since the last Round
};

}  // namespace usdlive::server
