// Encodes long lists as several control messages.
#pragma once

#include <algorithm>
#include <span>

#include "usdlive/common/core/ByteStream.h"
#include "usdlive/common/protocol/Frame.h"
#include "usdlive/common/protocol/ServerControl.h"

namespace usdlive::server {

/// Appends messages with parts of a list, each of about kUpdateBytes. `make` makes a message of
/// some elements.
template <class Element, class Make>
void appendUpdates(Bytes& frames, std::span<const Element> list, const Make& make) {
    std::size_t count = std::min<std::size_t>(list.size(), 1'000);
    for (; !list.empty(); list = list.subspan(count)) {
        count = std::min(count, list.size());
        std::string json = encodeControl(make(list.first(count)));
        // A message with fewer elements follows if this one has become too large.
        for (; json.size() > kUpdateBytes && count > 1;
             json = encodeControl(make(list.first(count))))
            count /= 2;
        appendBytes(frames, encodeFrame(ControlFrame{std::move(json)}));
    }
}

}  // namespace usdlive::server
