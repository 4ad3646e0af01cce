// Big values (V9): they travel beside the stream, and are stored before a transaction names them.
#pragma once

#include <functional>
#include <map>
#include <unordered_set>
#include <vector>

#include "Wiring.h"
#include "lines/LineListener.h"
#include "lines/StoreCondition.h"
#include "sessions/SessionTable.h"
#include "stream/KnownBlobs.h"
#include "stream/Previews.h"
#include "stream/UnusedBlobs.h"

namespace usdlive::server {

/// Receives uploads of big values, sends values on request, and knows which are stored and which
/// are of no use any more.
class BigValues : public LineListener, public SessionListener {
public:
    struct Limits {
        std::uint64_t maxBytes = 4ull << 30;      ///< of one value
        std::int64_t keepUnusedMs = 15 * 60'000;  ///< B6
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
    /// The store is being asked for it.
    [[nodiscard]] bool isSought(const Hash& hash) const { return known_.isAsked(hash); }
    /// Asks the store for values.
    void seek(std::vector<Hash> hashes);

    /// B6: values that the store may drop. `unnamed`: what its history does not name; `named`: what
    /// transactions name that are not executed yet.
    struct Round {
        const std::vector<Hash>& unnamed;
        Revision upTo = 0;
        std::int64_t nowMs = 0;
        const std::unordered_set<Hash>& named;
    };
    [[nodiscard]] std::vector<Hash> takeUnused(const Round& round);

    // Answers of the ports.
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
    /// By session: requests of values that the store is being asked for.
    std::map<SessionId, std::vector<RequestBlob>> requests_;
    std::unordered_set<SessionId> uploading_;  ///< since the last look at unused ones
};

}  // namespace usdlive::server
