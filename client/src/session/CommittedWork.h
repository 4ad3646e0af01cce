// Remembers own work that is committed, in case somebody deletes it without having seen it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "session/Pending.h"
#include "usdlive/client/session/Events.h"
#include "usdlive/common/layer/TransactionExecutor.h"

namespace usdlive::client {

/// The own work that was committed last (M17): at most kMostEdits edits, or kMostBytes as they were
/// sent. A larger transaction is not kept.
class CommittedWork {
public:
    static constexpr std::size_t kMostEdits = 4'096;
    static constexpr std::size_t kMostBytes = 4 * 1024 * 1024;

    /// `log` has the moves of the commit.
    void add(const NamespaceLog& log, const Commit& commit, Pending pending);
    /// Follows the moves and deletes in `log` with the work from revision `first` on. Call it for
    /// all work before the log is pruned.
    void follow(const NamespaceLog& log, Revision first = 0);
    /// Returns, and forgets, what a commit that deletes specs has taken although its author had not
    /// seen it. Its number is that of the last transaction. Call follow() with what it had not seen
    /// before the commit is applied, and this function afterwards.
    [[nodiscard]] std::optional<LostWork> takenBy(const NamespaceLog& log, const Commit& commit);
    void clear() { *this = {}; }

private:
    struct Written {
        std::string path;  // the path of the spec at `mark` of the log
        std::uint64_t mark;
        AuthoredEdit edit;
    };
    struct Work {
        Revision revision;
        std::uint64_t sequence;
        std::size_t bytes;
        std::vector<Written> edits;
    };

    [[nodiscard]] std::deque<Work>::iterator from(Revision first);

    std::deque<Work> work_;  // in the order of revisions
    std::size_t edits_ = 0, bytes_ = 0;
};

}  // namespace usdlive::client
