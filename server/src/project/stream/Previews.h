// The newest preview of each gesture in progress.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "stream/PreviewValues.h"
#include "usdlive/common/core/Bytes.h"
#include "usdlive/common/core/Id.h"

namespace usdlive::server {

/// The newest preview of each gesture in progress (M11), for sessions that join during a gesture. A
/// new preview replaces the gesture's earlier one.
class Previews {
public:
    /// The most gestures of an author. One more drops the oldest.
    static constexpr std::size_t kMaxGestures = 16;

    struct Preview {
        SharedBytes frame;
        std::vector<Hash> named;  ///< big values that it names
    };
    /// Keeps a preview. Returns the gesture that was dropped for it; 0 if none was.
    std::uint64_t keep(const ClientId& author, std::uint64_t gesture, Preview preview);
    /// Removes the gesture's preview. Returns false if there was none.
    bool end(const ClientId& author, std::uint64_t gesture);
    /// Removes the previews of all gestures of the author. Returns the gestures.
    std::vector<std::uint64_t> endAll(const ClientId& author);

    void forEach(const std::function<void(const ClientId&, const Preview&)>& visit) const;

    /// The big values that the previews name. They are removed with their gesture.
    PreviewValues values;

private:
    std::map<ClientId, std::map<std::uint64_t, Preview>> kept_;
};

}  // namespace usdlive::server
