// The big values that previews name.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <vector>

#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Id.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

/// The big values of previews (B3), in memory only, as the frames in which they came. A value goes
/// when its gesture ends, or when newer ones need its room.
class PreviewValues {
public:
    static constexpr std::size_t kMaxBytes = std::size_t(256) << 20;  ///< of all authors

    /// Adds the next part of a value; a first part begins it again. Other parts are dropped, and
    /// the value with them: its previews are shown without it, or not at all.
    void add(const ClientId& author, BlobFrame part);
    /// The frames of a whole value; nullptr: it is not here, or not whole.
    [[nodiscard]] const std::vector<SharedBytes>* find(const Hash& hash) const;
    void end(const ClientId& author, std::uint64_t gesture);
    void endAll(const ClientId& author);

    [[nodiscard]] std::size_t bytes() const { return bytes_; }

private:
    struct Entry {
        ClientId author;
        std::uint64_t gesture = 0;
        std::uint64_t size = 0, written = 0;
        std::size_t bytes = 0;  ///< that it takes here
        std::vector<SharedBytes> frames;
        std::list<Hash>::iterator turn;
    };
    using Entries = std::map<Hash, Entry>;

    Entries::iterator erase(Entries::iterator entry);
    template <class Ends>
    void endIf(const Ends& ends);

    Entries entries_;
    std::list<Hash> turns_;  // the oldest first
    std::size_t bytes_ = 0;
};

}  // namespace usdlive::server
