#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <set>

#include "Pending.h"

namespace usdlive::client {

/// An open gesture (M11): the transaction that will end it, so far.
struct Gesture {
    Pending pending;        ///< base and addresses always as of the session's revision
    bool untold = false;    ///< changed since the host was told of it
    bool changed = false;   ///< since the last preview
    bool shown = false;     ///< others may have a preview of it
    std::size_t bytes = 0;  ///< of the last preview
    std::int64_t sentMs = 0;

    /// A preview that waits until its big values have been sent before it (B3). Newer edits are in
    /// the next one.
    struct Outgoing {
        SharedBytes frame;
        struct Value {
            Hash hash;
            SharedBytes bytes;
        };
        std::deque<Value> values;  ///< not sent yet; the first one in part
        std::uint64_t offset = 0;  ///< of the first one
        std::set<Hash> named;      ///< all that it names and the server does not store
    };
    std::optional<Outgoing> outgoing;
    std::set<Hash> named;  ///< by the last preview that was sent, as above: the server has them

    /// From this size on a preview is sent at most every kBigPreviewMs.
    static constexpr std::size_t kBigPreviewBytes = 256 * 1024;
    static constexpr std::int64_t kBigPreviewMs = 100;
    /// Larger ones are not sent at all; a server does not pass them on.
    static constexpr std::size_t kMaxPreviewBytes = 1024 * 1024;
    /// Nor are previews with more bytes of big values.
    static constexpr std::size_t kMaxPreviewValueBytes = 64 * 1024 * 1024;

    /// Adds an edit; a write of a register that the gesture has just written takes the place of the
    /// one before. True: it did, so no edit was added.
    bool add(Edit edit, AuthoredEdit authored);
    /// Takes an edit out; what is for a spec that it created will be dropped.
    AuthoredEdit remove(std::uint32_t index);
    [[nodiscard]] bool due(std::int64_t nowMs) const {
        return changed && (bytes <= kBigPreviewBytes || nowMs - sentMs >= kBigPreviewMs);
    }
    [[nodiscard]] PreviewFrame preview() const;
    /// Others may hold something of it.
    [[nodiscard]] bool isKnown() const { return shown || outgoing; }
    /// A new connection: nothing of it has been sent.
    void disconnected() {
        shown = false;
        outgoing.reset();
        named.clear();
    }
};

}  // namespace usdlive::client
