// The big values that previews name.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <vector>

#include "usdlive/common/core/Budget.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

/// The big values of previews (B3), in memory only, as the received frames. A value is dropped when
/// its gesture ends, or when newer ones need the space (SE22).
class PreviewValues {
public:
    /// The limits for all authors together, and for those of a user. Beyond them the author with
    /// the most loses the oldest.
    static constexpr std::size_t kMaxBytes = std::size_t(256) << 20;
    static constexpr std::size_t kMaxUserBytes = kMaxBytes / 2;

    /// Adds the next part of a value, which takes of the limits of `share` (shareOf()); a first
    /// part starts it again. A part that does not follow the last one drops the value: its previews
    /// are shown without it, or not at all.
    void add(const ClientId& author, const std::string& share, BlobFrame part);
    /// Returns the frames of a complete value; nullptr if it does not exist or is incomplete.
    [[nodiscard]] const std::vector<SharedBytes>* find(const Hash& hash) const;
    void end(const ClientId& author, std::uint64_t gesture);
    void endAll(const ClientId& author);

    [[nodiscard]] std::size_t bytes() const { return bytes_.used(); }

private:
    struct Entry {
        ClientId author;
        std::uint64_t gesture = 0;
        std::uint64_t size = 0, written = 0;
        std::size_t bytes = 0;  ///< memory of the value
        std::vector<SharedBytes> frames;
        std::list<Hash>::iterator turn;
    };
    using Entries = std::map<Hash, Entry>;

    Entries::iterator erase(Entries::iterator entry);
    template <class Ends>
    void endIf(const Ends& ends);

    Entries entries_;
    std::list<Hash> turns_;                                               // oldest first
    Budget<ClientId> bytes_{{.group = kMaxUserBytes, .all = kMaxBytes}};  // by author
};

}  // namespace usdlive::server
