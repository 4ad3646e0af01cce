// Produces the frames of a session's sources in the background.
#include "transport/FrameSources.h"

#include <boost/asio/post.hpp>
#include <utility>

namespace usdlive::server {

bool FrameSources::add(FrameSource source) {
    if (sources_.size() >= Transport::kMaxSources) return false;
    sources_.push_back(std::make_shared<FrameSource>(std::move(source)));
    produce();
    return true;
}

void FrameSources::produce() {
    if (producing_ || sources_.empty()) return;
    const std::size_t most = session_.partBytes();
    if (most == 0) return;
    producing_ = true;
    auto source = std::move(sources_.front());
    sources_.pop_front();
    background_([source, most, &io = io_, weak = weak_from_this()] {
        std::optional<SharedBytes> frame;
        try {
            frame = (*source)(most);
        } catch (const std::exception&) {
            // Without failed() the client would wait for the rest for ever.
        }
        boost::asio::post(io, [source, frame = std::move(frame), weak] {
            if (const auto self = weak.lock()) self->onProduced(source, frame);
        });
    });
}

void FrameSources::onProduced(const std::shared_ptr<FrameSource>& source,
                              const std::optional<SharedBytes>& frame) {
    producing_ = false;
    if (cleared_) return;
    if (!frame) return session_.failed();
    if (*frame) {
        sources_.push_back(source);
        session_.send(*frame);
    }
    produce();
}

void FrameSources::clear() {
    sources_.clear();
    cleared_ = true;
}

}  // namespace usdlive::server
