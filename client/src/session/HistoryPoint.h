// The point of the server's history that the client has reached.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "session/MessageReader.h"
#include "session/PendingTransactions.h"
#include "usdlive/client/session/Events.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/FrameParts.h"

namespace usdlive::client {

/// Returns how messages name a history.
[[nodiscard]] std::string namedHistory(const std::string& project, const StoreId& store);

/// The newest commit that the confirmed layers contain, and whether a server has the history that
/// leads to it (ID2). Each connection resumes from here.
class HistoryPoint {
public:
    /// `pending` belongs to the session.
    explicit HistoryPoint(const PendingTransactions& pending) : pending_(pending) {}

    /// The revision of the confirmed layers.
    [[nodiscard]] const Revision& revision() const { return revision_; }
    /// The chain hash of that revision.
    [[nodiscard]] const Hash& hash() const { return hash_; }
    /// The identity of the project's store (ID1); empty: unknown.
    [[nodiscard]] const StoreId& store() const { return store_; }
    /// Returns false before the first welcome.
    [[nodiscard]] bool isKnown() const { return isKnown_; }

    // A connection.
    /// Returns what the hello of a new connection says; nothing if isKnown() is false.
    [[nodiscard]] std::optional<Hello::Resume> connecting();
    /// Takes an error that came before the welcome. Returns true if that is all: what follows from
    /// it is decided when the welcome has come.
    bool takesBeforeWelcome(const ErrorMessage& message);
    /// The server has forgotten what it knew about this client (M14); an error before the welcome.
    [[nodiscard]] const std::optional<Error>& forgotten() const { return forgotten_; }

    // A welcome: compare(), then welcomed(), and beginAt() if the client was not resumed.
    enum class Found { Same, Other, AcceptedOther };
    /// Compares the server's history with that of the client, whose project has this name.
    Found compare(const Welcome& found, const std::string& project);
    void welcomed(const Welcome& message);
    /// The transactions that were sent before are not answered, and the layers are joined again at
    /// `joined`.
    void leaveUnanswered(Revision joined);
    void beginAt(const Welcome& message);

    /// ID2: set while the session has stopped.
    [[nodiscard]] const std::optional<OtherHistory>& other() const { return other_; }
    /// ID4: the next welcome may have this other history. Error: InvalidArgument (there is none).
    Result<void> acceptOther();

    // Commits.
    /// Returns whether the client has the commit already, or it is of an epoch that has passed.
    [[nodiscard]] bool isPast(const Commit& commit) const;
    /// Advances to a commit, and gives it the complete hash of the one before. Error:
    /// HistoryDiverged (it does not follow).
    Result<void> advance(ReceivedCommit& received);

private:
    // Transactions up to `last` were sent when the client had the history up to `since`, and are
    // not answered. Until they are, hello names `since`: the server then knows whether it has
    // forgotten what it knew about them (M14).
    struct Unanswered {
        Revision since = 0;
        std::uint64_t last = 0;
    };
    [[nodiscard]] bool hasUnanswered() const;

    const PendingTransactions& pending_;
    bool isKnown_ = false;
    Revision revision_ = 0;
    Hash hash_;
    StoreId store_;
    Epoch epoch_ = 0;        // epoch of the server
    Epoch commitEpoch_ = 0;  // epoch of the newest commit
    std::optional<Unanswered> unanswered_;
    std::optional<Error> forgotten_;
    bool diverged_ = false;  // an error before the welcome says that the histories differ
    std::optional<OtherHistory> other_;
    std::optional<StoreId> accepted_;  // the other history that the client may join
};

}  // namespace usdlive::client
