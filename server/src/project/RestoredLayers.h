// Begins a line of history at an earlier revision.
#pragma once

#include <cstdint>
#include <string>

#include "project/CommitStore.h"

namespace usdlive::server {

/// The author, the time and the label of the commit that restores layers.
struct Restoring {
    UserName user;
    std::int64_t timeMs = 0;  ///< milliseconds since 1970
    std::string label;
};

/// Appends one commit to a store that nobody else uses, after which all layers have the content of
/// an earlier revision. A layer that was imported later has the content of its import. Returns the
/// newest revision, which is that of the commit if something differs. Blocks; any thread. Errors:
/// InvalidArgument (there is no such revision), HistoryReplaced (it is not there any more),
/// TransactionTooLarge, those of the store.
[[nodiscard]] Result<Revision> restoreLayers(CommitStore& store, Revision revision,
                                             const Restoring& by);

}  // namespace usdlive::server
