// An own transaction that the server has not answered.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "session/Session.h"
#include "usdlive/common/layer/Edit.h"

namespace usdlive::client {

/// A spec that a transaction touches, at its path in the view.
struct Touched {
    LayerId layer;
    std::string path;
};

/// The result of a transaction when it was last executed on the view.
struct Expectation {
    /// The spec of each edit, in order; for a move also its new place.
    std::vector<Touched> touched;
    std::uint64_t names = 0;  ///< length of the predicted namespace log after this transaction
    bool complete = true;     ///< no edit was dropped or refused
    bool refused = false;     ///< the whole transaction was refused: the view shows none of it
};

/// An own transaction that the server has not answered.
struct Pending {
    Transaction transaction;
    std::vector<AuthoredEdit> authored;  ///< one for each edit, as the editor made it
    Expectation expectation;
    std::vector<Value> blobs;  ///< big values that it names
    bool sent = false;         ///< on this connection
    bool everSent = false;     ///< under its present number
    /// Its edits have other addresses than those that were sent (FR11).
    bool changedSince = false;
    std::size_t sentBytes = 0;
    int attempts = 0;  ///< how often the session has corrected and sent it again
    /// While the client joins another history (HistoryDiverged): its edits with their paths in the
    /// old one; nothing for dropped edits.
    std::vector<std::optional<AuthoredEdit>> carried;
    /// By index of the edit: places at the base of specs that it creates, and of edits of places,
    /// below specs of pending work. Noted for `placesOf` edits, when others move objects (M15).
    std::map<std::uint32_t, std::string> places = {};
    std::size_t placesOf = 0;
};

/// Returns the revision since which moves (M3), and what others have named (M16), are needed to
/// execute a transaction.
[[nodiscard]] inline Revision neededSince(const Transaction& transaction) {
    return std::min(transaction.base, newestSeen(transaction));
}

/// Returns whether both set the same register, so that only the later one has an effect. False for
/// fields in which the order of items matters.
[[nodiscard]] bool setSameRegister(const EditAction& earlier, const EditAction& later);

/// Adds the big values that an action names.
void collectBlobs(const EditAction& action, std::vector<Value>& blobs);

}  // namespace usdlive::client
