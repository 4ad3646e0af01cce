// The unused big values of the store, and since when they are unused.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <unordered_map>
#include <vector>

#include "project/Project.h"

namespace usdlive::server {

/// Notes since when big values in the store are unused (B6).
class UnusedBlobs {
public:
    /// Call it when a commit names the values. The commit may not be in the store yet.
    void named(const std::vector<Hash>& blobs, Revision revision);
    /// Call it when the commits after `durable` were rolled back.
    void rolledBack(Revision durable);
    /// Call it when a client was notified that the value is stored. The client may commit an edit
    /// that names it.
    void stored(const Hash& hash, SessionId session);

    struct Round {
        const std::vector<Hash>& unnamed;  ///< values that no commit up to `upTo` names
        Revision upTo = 0;
        std::int64_t nowMs = 0, keepMs = 0;
        /// Returns whether something that is not in the store names the value.
        std::function<bool(const Hash&)> isNamed;
        /// Returns whether the session is still uploading. Its transaction may wait for further
        /// values.
        std::function<bool(SessionId)> uploads;
    };
    /// Returns the values that were unused for `keepMs`, in each round since then, and forgets
    /// them. Returns none if a later round was finished before this one.
    [[nodiscard]] std::vector<Hash> take(const Round& round);

private:
    struct Unused {
        std::optional<std::int64_t> sinceMs;  ///< nothing: since the last round
        SessionId session = 0;                ///< the session that was notified last; 0: none
    };
    Revision upTo_ = 0;                         // revision of the last round
    std::unordered_map<Hash, Revision> named_;  // last commit after upTo_ that names the value
    std::unordered_map<Hash, Unused> unused_;
};

}  // namespace usdlive::server
