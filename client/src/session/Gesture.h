#pragma once

#include <cstdint>
#include <optional>

#include "Pending.h"

namespace usdlive::client {

/// An open gesture (M11): the transaction that will end it, so far.
struct Gesture {
    Pending pending;        ///< base and addresses always as of the session's revision
    bool changed = false;   ///< since the last preview
    bool shown = false;     ///< others may have a preview of it
    std::size_t bytes = 0;  ///< of the last preview
    std::int64_t sentMs = 0;

    /// From this size on a preview is sent at most every kBigPreviewMs.
    static constexpr std::size_t kBigPreviewBytes = 256 * 1024;
    static constexpr std::int64_t kBigPreviewMs = 100;
    /// Larger ones are not sent at all; a server does not pass them on.
    static constexpr std::size_t kMaxPreviewBytes = 1024 * 1024;

    /// Adds an edit; a write of a register that the gesture has just written takes the place of the
    /// one before. True: it did, so no edit was added.
    bool add(Edit edit, AuthoredEdit authored);
    /// Takes an edit out; what is for a spec that it created will be dropped.
    AuthoredEdit remove(std::uint32_t index);
    [[nodiscard]] bool due(std::int64_t nowMs) const {
        return changed && (bytes <= kBigPreviewBytes || nowMs - sentMs >= kBigPreviewMs);
    }
    [[nodiscard]] PreviewFrame preview() const;
};

}  // namespace usdlive::client
