// The newest preview of each gesture in progress.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "project/stream/PreviewValues.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The newest preview of each gesture in progress (M11), for sessions that join during a gesture. A
/// new preview replaces the gesture's earlier one.
class Previews {
public:
    /// The most gestures of an author. One more drops the oldest.
    static constexpr std::size_t kMaxGestures = 16;
    /// The limits of memory for all authors together, and for those of a user (SE22). Beyond them
    /// the author with the most loses the oldest gesture.
    static constexpr std::size_t kMaxBytes = std::size_t(256) << 20;
    static constexpr std::size_t kMaxUserBytes = kMaxBytes / 4;

    struct Preview {
        SharedBytes frame;
        std::vector<Hash> named;  ///< big values that it names
    };
    using Gesture = std::pair<ClientId, std::uint64_t>;
    /// Keeps a preview, which takes of the limits of `share` (shareOf()). Returns the gestures that
    /// were dropped for it.
    std::vector<Gesture> keep(const ClientId& author, const std::string& share,
                              std::uint64_t gesture, Preview preview);
    /// Removes the gesture's preview. Returns false if there was none.
    bool end(const ClientId& author, std::uint64_t gesture);
    /// Removes the previews of all gestures of the author. Returns the gestures.
    std::vector<std::uint64_t> endAll(const ClientId& author);

    void forEach(const std::function<void(const ClientId&, const Preview&)>& visit) const;

    /// The big values that the previews name. They are removed with their gesture.
    PreviewValues values;

private:
    using Gestures = std::map<std::uint64_t, Preview>;  // not empty

    [[nodiscard]] static std::size_t bytesOf(const Preview& preview);
    void drop(std::map<ClientId, Gestures>::iterator author, Gestures::iterator gesture);

    std::map<ClientId, Gestures> kept_;
    Budget<ClientId> bytes_{{.group = kMaxUserBytes, .all = kMaxBytes}};
};

}  // namespace usdlive::server
