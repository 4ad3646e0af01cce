// An open gesture of this client (M11).
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <set>

#include "session/Pending.h"

namespace usdlive::client {

/// An open gesture (M11): the edits so far of the transaction that will end it.
struct Gesture {
    Pending pending;          ///< base and addresses are always those at the session's revision
    bool unreported = false;  ///< changed since SessionHost::pending()
    bool changed = false;     ///< since the last preview
    bool shown = false;       ///< others may have a preview of it
    std::size_t bytes = 0;    ///< size of the last preview
    std::int64_t sentMs = 0;

    /// A preview that waits until its big values have been sent (B3). The next preview has newer
    /// edits.
    struct Outgoing {
        SharedBytes frame;
        struct Value {
            Hash hash;
            SharedBytes bytes;
        };
        std::deque<Value> values;  ///< not sent yet; the first one may be sent in part
        std::uint64_t offset = 0;  ///< position in the first one
        std::set<Hash> named;      ///< all values that it names and the server does not store
    };
    std::optional<Outgoing> outgoing;
    std::set<Hash> named;  ///< values of the last sent preview, as above: the server has them

    /// A preview of this size or more is sent at most every kBigPreviewMs.
    static constexpr std::size_t kBigPreviewBytes = 256 * 1024;
    static constexpr std::int64_t kBigPreviewMs = 100;
    /// Larger previews are not sent: a server does not forward them.
    static constexpr std::size_t kMaxPreviewBytes = 1024 * 1024;
    /// Previews with more bytes of big values are not sent, either.
    static constexpr std::size_t kMaxPreviewValueBytes = 64 * 1024 * 1024;

    /// Adds an edit, or replaces an earlier write of the same register. Returns its number.
    std::size_t add(Edit edit, AuthoredEdit authored);
    /// Removes an edit. Edits of a spec that it created will be dropped.
    AuthoredEdit remove(std::uint32_t index);
    [[nodiscard]] bool due(std::int64_t nowMs) const {
        return changed && (bytes <= kBigPreviewBytes || nowMs - sentMs >= kBigPreviewMs);
    }
    [[nodiscard]] PreviewFrame preview() const;
    /// Others may have received something of it.
    [[nodiscard]] bool isKnown() const { return shown || outgoing; }
    /// Called when the connection is lost: the next one has sent nothing of it.
    void disconnected() {
        shown = false;
        outgoing.reset();
        named.clear();
    }
};

}  // namespace usdlive::client
