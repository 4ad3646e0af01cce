// Sends frames to the server of the present connection.
#include "session/Channel.h"

#include <algorithm>

namespace usdlive::client {

void Channel::connected() {
    takesCompact_ = false;
    names_ = {};
    namesSent_ = {};
}

void Channel::welcomed(const Welcome& message) {
    welcome_ = message;
    welcome_->layers.clear();
    online_ = true;
    takesPreviewValues_ = knows("previewValues");
    takesCompact_ = knows(kCompactFeature);
}

bool Channel::knows(std::string_view feature) const {
    return std::ranges::count(welcome_->features, feature) > 0;
}

std::uint64_t Channel::frameLimit() const {
    return welcome_->maxFrameBytes > 0 ? welcome_->maxFrameBytes : kMaxFrameBytes;
}

std::uint64_t Channel::transactionLimit() const {
    return welcome_->maxTransactionBytes.value_or(kMaxTransactionBytes);
}

void Channel::send(std::string control) { send(encodeFrame(ControlFrame{std::move(control)})); }

}  // namespace usdlive::client
