// Reads the history of a project.
#include "history/HistoryReader.h"

#include <algorithm>

namespace usdlive::client {

Result<void> readBackward(HistoryReader& reader, Revision newest, Revision oldest,
                          const std::function<bool(const Commit&)>& visit, AtBase atBase,
                          Revision page) {
    for (Revision to = newest; to >= oldest && to > 0;) {
        const Revision from = to - oldest >= page ? to - page + 1 : oldest;
        const auto commits = reader.readLog(from, to);
        if (!commits && commits.error().code == ErrorCode::HistoryReplaced &&
            atBase == AtBase::End) {
            // The first one is not there any more. Looks for the oldest that is, in half as many.
            oldest = from + 1;
            page = std::max<Revision>((to - from + 1) / 2, 1);
            continue;
        }
        if (!commits) return tl::unexpected(commits.error());
        for (auto commit = commits->rbegin(); commit != commits->rend(); ++commit)
            if (!visit(*commit)) return {};
        to = from - 1;
    }
    return {};
}

}  // namespace usdlive::client
