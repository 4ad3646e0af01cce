// Searches the history: for commits, and for the authors of opinions.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "history/HistoryReader.h"
#include "usdlive/client/history/History.h"

namespace usdlive::client {

/// Returns the next commits that the query chooses. A page reads about 10,000 commits at most.
/// Error: InvalidArgument (a path without a layer, or one that is none), those of the reader.
[[nodiscard]] Result<LogPage> searchLog(HistoryReader& reader, const LogQuery& query);

/// Returns the commit with these edits only.
[[nodiscard]] Commit onlyEdits(const Commit& commit, const std::vector<std::size_t>& edits);

/// Finds who has made the opinions of a spec and its properties, or with `below` also of everything
/// below it. `path` is a spec, or a spec and a field (`/World/Ball.radius.default`), which is
/// looked at part by part. Reads what was there before for the opinions of the newest 20 commits.
/// Errors: SpecNotFound, those of the reader.
[[nodiscard]] Result<BlameResult> findBlame(HistoryReader& reader, const LayerId& layer,
                                            const std::string& path, bool below);

}  // namespace usdlive::client
