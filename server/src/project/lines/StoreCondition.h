// Whether the store accepts commits at the moment.
#pragma once

#include <optional>

#include "usdlive/common/core/Result.h"

namespace usdlive::server {

/// Whether the project's store accepts commits at the moment (SE8), as far as the project was
/// notified.
struct StoreCondition {
    bool hasSpace = true;
    /// An append has failed, and the content of the store is unknown until it is opened again.
    /// Until then nothing is requested from it.
    bool closed = false;

    [[nodiscard]] std::optional<Error> whyClosed() const {
        if (!closed) return std::nullopt;
        return Error{ErrorCode::StorageFailed, "the store has failed and is being opened again"};
    }
    [[nodiscard]] std::optional<Error> whyNotWritable() const {
        if (closed) return whyClosed();
        if (hasSpace) return std::nullopt;
        return Error{ErrorCode::StorageFull, "the disk of the server is full"};
    }
};

}  // namespace usdlive::server
