// When big values in the store may be removed.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <unordered_map>
#include <vector>

#include "usdlive/server/project/Project.h"

namespace usdlive::server {

/// Notes since when big values in the store have been of no use (B6).
class UnusedBlobs {
public:
    /// A commit names them that may not be in the store yet.
    void named(const std::vector<Hash>& blobs, Revision revision);
    /// Commits after `durable` are no more: the store could not append them.
    void rolledBack(Revision durable);
    /// A client was sent that the value is stored, and may be about to commit an edit that names
    /// it.
    void stored(const Hash& hash, SessionId session);

    struct Round {
        const std::vector<Hash>& unnamed;  ///< by what the store holds up to `upTo`
        Revision upTo = 0;
        std::int64_t nowMs = 0, keepMs = 0;
        /// Does anything name the value that is not in the store?
        std::function<bool(const Hash&)> isNamed;
        /// Does the session still upload? What it uploaded before may wait for that.
        std::function<bool(SessionId)> uploads;
    };
    /// Those that were of no use for `keepMs`, in each round since then. They are forgotten. None
    /// by a round that looked at the store before another one did that is over.
    [[nodiscard]] std::vector<Hash> take(const Round& round);

private:
    struct Unused {
        std::optional<std::int64_t> sinceMs;  ///< nothing: since after the last round
        SessionId session = 0;                ///< that was notified last; 0 none
    };
    Revision upTo_ = 0;                         // of the last round
    std::unordered_map<Hash, Revision> named_;  // by commits after it
    std::unordered_map<Hash, Unused> unused_;
};

}  // namespace usdlive::server
