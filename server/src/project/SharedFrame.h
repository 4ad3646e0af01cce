// Encodes frames once, so that they can be sent to several sessions.
#pragma once

#include <memory>

#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::server {

[[nodiscard]] inline SharedBytes sharedFrame(const Frame& frame) {
    return std::make_shared<const Bytes>(encodeFrame(frame));
}
[[nodiscard]] inline SharedBytes sharedFrame(const ControlMessage& message) {
    return sharedFrame(ControlFrame{encodeControl(message)});
}

}  // namespace usdlive::server
