#pragma once

#include <string>

#include "usdlive/common/protocol/Control.h"

namespace usdlive::server {

/// `head`: the store's newest revision; `known`: it has one of that name.
inline Result<void> mayAdd(const Checkpoint& checkpoint, Revision head, bool known) {
    if (checkpoint.revision > head)
        return fail(ErrorCode::FutureRevision, "the newest revision is " + std::to_string(head));
    if (known)
        return fail(ErrorCode::CheckpointExists,
                    "there is a checkpoint '" + checkpoint.name + "' already");
    return {};
}

}  // namespace usdlive::server
