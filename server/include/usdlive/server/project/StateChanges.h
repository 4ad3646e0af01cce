#pragma once

#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/server/project/CommitStore.h"

namespace usdlive::server {

/// What the executed edits of one commit change in the stored state. `layers` stands after all of
/// them.
[[nodiscard]] std::vector<StateChange> stateChanges(const LayerDocs& layers,
                                                    const std::vector<ExecutedEdit>& edits);

/// The moves and deletes among the executed edits.
[[nodiscard]] std::vector<NamespaceChange> namespaceChanges(Revision revision,
                                                            const std::vector<ExecutedEdit>& edits);

}  // namespace usdlive::server
