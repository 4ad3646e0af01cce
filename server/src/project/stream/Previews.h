// The newest preview of each gesture under way.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "stream/PreviewValues.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The newest preview of every gesture under way (M11), for sessions that come in the middle of
/// one. One is kept for each gesture: a new preview takes the place of the one before.
class Previews {
public:
    /// An author's gestures beyond this many at once push out the oldest.
    static constexpr std::size_t kMaxGestures = 16;

    struct Preview {
        SharedBytes frame;
        std::vector<Hash> named;  ///< big values
    };
    /// Returns the gesture it pushed out, 0 for none.
    std::uint64_t keep(const ClientId& author, std::uint64_t gesture, Preview preview);
    /// The gesture is over. False when nothing was kept of it.
    bool end(const ClientId& author, std::uint64_t gesture);
    /// The author's gestures are over. Returns them.
    std::vector<std::uint64_t> endAll(const ClientId& author);

    void forEach(const std::function<void(const ClientId&, const Preview&)>& visit) const;

    /// The big values that they name; those of a gesture end with it.
    PreviewValues values;

private:
    std::map<ClientId, std::map<std::uint64_t, Preview>> kept_;
};

}  // namespace usdlive::server
